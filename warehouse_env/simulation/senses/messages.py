"""Messages lost: what a robot tells the others in an env step reaches nobody, and they go on with what they knew.

A robot whose messages are lost (`silent` of its record)

- is in no other's observation but by lidar: not among the neighbours, and so in no prediction;
- commits under the protective field unheard: the others count on the stop that they last knew of, and learn where it
  is, and the stop from there, a physics step later;
- is granted its stretch by right of way unheard: the others know of the one it had in the decision before.

Its place and the poses ahead of it stay known to the field and to right of way: a robot that stays unheard for long is
not modelled. Whose messages are lost is drawn before each env step from a stream of the world's own, apart from its
tasks', so that the same seed has the same tasks whatever is lost.
"""

from __future__ import annotations

from collections import defaultdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

_STREAM = 1  # behind the world's own entropy


class Messages:
    """Draws who is silent; `share` of the robots of an env step, in the mean."""

    def __init__(self, share: float) -> None:
        self._share = share
        # made when first used, as the Dispatcher's
        self._rngs: defaultdict[int, np.random.Generator] = defaultdict(np.random.default_rng)

    def begin(self, world: int, entropy: list[int] | None) -> None:
        """Begin a world's episode; entropy: what its generator is seeded with; None: it goes on."""
        if entropy is not None:
            self._rngs[world] = np.random.default_rng(np.random.SeedSequence([*entropy, _STREAM]))

    def lose(self, robots: NDArray[Any]) -> None:
        """Write who of robots ROBOT[B, N] is silent in the env step to come."""
        if self._share == 0:
            return
        for world in range(len(robots)):
            robots["silent"][world] = self._rngs[world].random(robots.shape[1]) < self._share
