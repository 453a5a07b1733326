"""Whose limits and whose body: of a fleet of several kinds each robot has its own, else all have those of the world."""

from __future__ import annotations

from warehouse_env.kernel import inline


@inline
def kind_of(i, p, kinds):
    """Return the parameters of robot i: its own of kinds PARAMETERS[N], or p where these are None, for all are alike.

    Which of both is known when this is compiled, so that a fleet of one kind pays nothing.
    """
    if kinds is None:
        return p
    return kinds[i]
