"""A binary heap in two arrays: keys float32[M] and items int32[M]; who comes first depends on the pushes alone."""

from __future__ import annotations

from warehouse_env.kernel import inline


@inline
def push(keys, items, size, key, item):
    """Add an item to a heap of `size`; return the new size."""
    at = size
    while at > 0:
        above = (at - 1) >> 1
        if keys[above] <= key:
            break
        keys[at], items[at] = keys[above], items[above]
        at = above
    keys[at], items[at] = key, item
    return size + 1


@inline
def pop(keys, items, size):
    """Take the item with the least key from a heap of `size` >= 1; return (key, item, new size)."""
    first_key, first = keys[0], items[0]
    size -= 1
    key, item = keys[size], items[size]
    at = 0
    while 2 * at + 1 < size:
        below = 2 * at + 1
        if below + 1 < size and keys[below + 1] < keys[below]:
            below += 1
        if keys[below] >= key:
            break
        keys[at], items[at] = keys[below], items[below]
        at = below
    keys[at], items[at] = key, item
    return first_key, first, size
