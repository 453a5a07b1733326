"""Limits and body of a robot: its own in a fleet of several kinds, else those of the world."""

from warehouse_env.kernel import inline


@inline
def kind_of(i, p, kinds):
    """Return the parameters of robot i: of kinds PARAMETERS[N], or p if kinds is None.

    The choice is made when this is compiled, so a fleet of one kind pays nothing.
    """
    if kinds is None:
        return p
    return kinds[i]


@inline
def many_alike(begin, robots, kinds, most):
    """Return how many robots from `begin` on are of one kind, at most `most`."""
    most = min(most, robots - begin)
    if kinds is None:
        return most
    count = 1
    while count < most and kinds[begin + count]["kind"] == kinds[begin]["kind"]:
        count += 1
    return count
