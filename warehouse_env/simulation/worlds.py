"""What the kernels of a batch of worlds are given: tuples of arrays by what they are for, so that none are mixed up.

What a config has not is None, and not compiled: Numba leaves out a branch on an argument that is None. A field that may
be None is therefore handed to a small function, which asks.
"""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import EnvConfig
from warehouse_env.simulation.physics import deviation
from warehouse_env.simulation.physics.zones import Zones
from warehouse_env.simulation.senses.scanners import Scanners
from warehouse_env.simulation.traffic import audit

Floats = NDArray[np.float32]


class Features(NamedTuple):
    """What a config has: True, or None where it has not."""

    followed: Literal[True] | None  # actions are commands to the path follower, not raw
    stopping: Literal[True] | None  # robots arrive at their goals when they stand there (driver/arrival.py)
    walking: Literal[True] | None  # people
    guarded: Literal[True] | None  # the protective field
    checked: Literal[True] | None  # and looked for faults (audit.py)
    erring: Literal[True] | None  # bodies that are not quite where their robots have planned to be (deviation.py)

    @classmethod
    def of(cls, config: EnvConfig) -> Features:
        """Return the features of a config."""
        field = config.traffic_spec.shield
        checked = field and audit.is_wanted()
        stopping = config.arrival != "pass"
        has = (config.action_type != "raw", stopping, config.people > 0, field, checked, deviation.errs(config))
        return cls(*(True if one else None for one in has))


class Worlds(NamedTuple):
    """The arrays of B worlds of N robots and M people."""

    robots: NDArray[np.void]  # ROBOT[B, N], as they have planned to be
    routes: Floats  # [B, N, R, 2] [m]
    arcs: Floats  # [B, N, ARCS, 2], their manoeuvres (manoeuvre.py)
    commands: Floats  # [S, B, N, 2], the latest first: speed [m/s] and offset [m], or raw acceleration, steering rate
    persons: NDArray[np.void]  # PERSON[B, M]
    ways: Floats  # [B, M, H, W], see people.People
    limits: NDArray[np.void] | None  # PARAMETERS[B, N], of robots under loads (loads.py)
    sights: Floats | None  # [B, N, N], see by_sight.py
    actual: NDArray[np.void]  # BODY[B, N], where erring bodies are, and
    errors: NDArray[Any]  # what they err by (deviation.py)
    stamps: NDArray[np.int32]  # [B, N, K, 2], see contact_episodes.judge_pairs
    steps: NDArray[np.int64]  # [B], since the reset
    truncated: NDArray[np.bool_]  # [B]
    terminated: NDArray[np.bool_]  # [B, N]
    waiting: NDArray[np.int32]  # [B], arrivals, whose worlds are observed once the Simulator has given out new tasks
    faults: NDArray[np.int32]  # [B, 3], see audit.find_fault
    observation: Floats  # [B, N, D]
    terms: Floats  # [B, N, T], of the reward
    reward: Floats  # [B, N]


class Vehicles(NamedTuple):
    """The parameters of the robots."""

    shared: NDArray[np.void]  # PARAMETERS[1]
    kinds: NDArray[np.void] | None  # PARAMETERS[N], where there are several kinds (kinds.py)


class Equipment(NamedTuple):
    """Static arrays of what robots have and floors demand, if they do."""

    scanners: Scanners | None
    zones: Zones | None


class Senses(NamedTuple):
    """How robots observe."""

    rays: Floats  # [2, R], unit vectors in the robot's frame
    table: Floats | None  # [K, A, 2], the commands of each kind of robots, for predictions
    weights: Floats  # [T], of the reward's terms


class Scratch(NamedTuple):
    """Arrays that a world's step writes before it reads them."""

    places: Any  # buckets.scratch
    motions: Any  # contact.scratch
    near: NDArray[np.int64]  # [1], how many pairs of robots may meet
    guards: Any  # field.scratch
    looks: Any  # by_sight.scratch, or None
    own: Floats  # the motions of the bodies, where these err (deviation.py); else those of `motions`
