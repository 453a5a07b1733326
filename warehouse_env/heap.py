"""A binary heap in arrays: keys and items, and ties where entries of the same key have an order.

Which entry comes first depends on the pushes alone: an entry passes another only if it is less. The caller makes room
and keeps the size.
"""

from warehouse_env.kernel import inline


@inline
def _tie(ties, i):
    """Return the tie of an entry, None where there are no ties."""
    if ties is None:
        return None
    return ties[i]


@inline
def _is_less(key, tie, other_key, other_tie):
    """Whether an entry comes before another."""
    if tie is None:
        return key < other_key
    return key < other_key or (key == other_key and tie < other_tie)


@inline
def _put(keys, items, ties, at, key, item, tie):
    """Write an entry."""
    keys[at], items[at] = key, item
    if ties is not None:
        ties[at] = tie


@inline
def push(keys, items, size, key, item, ties=None, tie=None):
    """Add an item to a heap of `size`; return the new size. keys, ties: numbers [M]; items: whole numbers [M]."""
    at = size
    while at > 0:
        above = (at - 1) >> 1
        if not _is_less(key, tie, keys[above], _tie(ties, above)):
            break
        _put(keys, items, ties, at, keys[above], items[above], _tie(ties, above))
        at = above
    _put(keys, items, ties, at, key, item, tie)
    return size + 1


@inline
def pop(keys, items, size, ties=None):
    """Take the least entry from a heap of `size` >= 1; return (its key, its item, the new size)."""
    first_key, first = keys[0], items[0]
    size -= 1
    key, item, tie = keys[size], items[size], _tie(ties, size)
    at = 0
    while 2 * at + 1 < size:
        below = 2 * at + 1
        if below + 1 < size and _is_less(keys[below + 1], _tie(ties, below + 1), keys[below], _tie(ties, below)):
            below += 1
        if not _is_less(keys[below], _tie(ties, below), key, tie):
            break
        _put(keys, items, ties, at, keys[below], items[below], _tie(ties, below))
        at = below
    _put(keys, items, ties, at, key, item, tie)
    return first_key, first, size
