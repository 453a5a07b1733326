"""Random delays, as the League of Robot Runners draws them in 2026 (DelayGenerator.cpp of its Start-Kit).

In each tick, robots that are not delayed may become so: each with a given probability, or a Poisson-distributed number
of them. A delay lasts a number of ticks from a uniform distribution, or from a normal one, rounded and cut off at the
limits. Random numbers are NumPy's, so a seed gives other delays than in the League.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from warehouse_env.checked import Checked
from warehouse_env.errors import ConfigError
from warehouse_env.files import read_json

_LARGEST = 2**20  # [bytes] of a file
_EVENTS, _DURATIONS = ("bernoulli", "poisson"), ("uniform", "gaussian")
_NAMES = {
    "pDelay": "probability", "minDelay": "shortest", "maxDelay": "longest", "eventModel": "events",
    "durationModel": "durations", "gaussMeanRatio": "mean", "gaussStdRatio": "deviation",
}  # fmt: skip


@dataclass(frozen=True)
class Delays(Checked):
    """How often robots are held up, and for how long."""

    tick: float  # [s]
    probability: float  # of a robot, each tick
    shortest: int = 1  # [ticks]
    longest: int = 1  # [ticks]
    events: str = "bernoulli"  # each robot by itself; or poisson: a number of them
    durations: str = "uniform"  # or gaussian
    mean: float = 0.5  # of gaussian durations: where between the shortest, 0, and the longest, 1
    deviation: float = 0.0  # standard deviation of these, as a share of the longest less the shortest
    ranges: ClassVar = {
        "tick": (1e-3, 1e6), "probability": (0.0, 1.0), "shortest": (1, 10**9), "longest": (1, 10**9),
        "mean": (0.0, 1.0), "deviation": (0.0, 1e6),
    }  # fmt: skip

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require(self.longest >= self.shortest, "longest", "at least the shortest")
        self._require(self.events in _EVENTS, "events", " or ".join(_EVENTS))
        self._require(self.durations in _DURATIONS, "durations", " or ".join(_DURATIONS))


def read_delays(path: Path, move: float) -> Delays:
    """Return the delays of a problem file of the League; ConfigError if it has none. move: seconds to the next cell."""
    data = read_json(path, "problem", _LARGEST, ConfigError)
    found = data.get("delayConfig") if isinstance(data, dict) else None
    ticks = data.get("agentCounter", 10) if isinstance(data, dict) else 0
    if not isinstance(found, dict) or not isinstance(ticks, int) or ticks < 1:
        raise ConfigError(f"{path} has no `delayConfig` as problems of the League of Robot Runners 2026 have it")
    given = {own: found[name] for name, own in _NAMES.items() if name in found}
    try:
        return Delays(**{"tick": move / ticks, "probability": 0.0} | given)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None


class DelayClock:
    """Draws the delays of N robots, tick by tick."""

    def __init__(self, delays: Delays, robots: int, rng: np.random.Generator) -> None:
        self._delays, self._rng, self._ticks = delays, rng, 0
        self._left = np.zeros(robots, np.int64)  # ticks for which each is still held up

    def held(self, seconds: float) -> NDArray[np.bool_]:
        """Return bool[N]: who is held up, so many seconds after the start; they must not fall."""
        while self._ticks <= math.floor(seconds / self._delays.tick + 1e-9):
            self._next()
        return self._left > 0

    def _next(self) -> None:
        delays, rng = self._delays, self._rng
        self._ticks += 1
        self._left = np.maximum(self._left - 1, 0)
        free = np.flatnonzero(self._left == 0)
        if delays.events == "poisson":
            count = min(int(rng.poisson(len(self._left) * delays.probability)), len(free))
            late = rng.choice(free, count, replace=False)
        else:
            late = free[rng.random(len(free)) < delays.probability]
        self._left[late] = self._lengths(len(late))

    def _lengths(self, count: int) -> NDArray[np.int64]:
        delays, rng = self._delays, self._rng
        if delays.durations == "uniform":
            return rng.integers(delays.shortest, delays.longest, count, endpoint=True)
        span = delays.longest - delays.shortest
        drawn = np.rint(rng.normal(delays.shortest + span * delays.mean, span * delays.deviation, count))
        return np.clip(drawn, delays.shortest, delays.longest).astype(np.int64)
