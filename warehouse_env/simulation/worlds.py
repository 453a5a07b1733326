"""Arguments of the kernels of a batch of worlds: tuples of arrays, by purpose.

A feature that a config does not use is None and not compiled: Numba leaves out a branch on an argument that is None. So
a field that may be None is passed on as an argument to the function that asks.
"""

import threading
from collections.abc import Callable
from functools import cached_property
from typing import Any, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from warehouse_env.config import EnvConfig
from warehouse_env.observation import Starts
from warehouse_env.simulation.physics import buckets, contact, deviation
from warehouse_env.simulation.physics.floor import Floor
from warehouse_env.simulation.physics.zones import Zones
from warehouse_env.simulation.senses import plans
from warehouse_env.simulation.senses.passages import Passages
from warehouse_env.simulation.traffic import reservations, shield, waits

Floats = NDArray[np.float32]


class Features(NamedTuple):
    """Features of a config: True, or None if it does not use one."""

    followed: Literal[True] | None  # actions are commands to the path follower, not raw
    stopping: Literal[True] | None  # robots stop at their goals (driver/arrival.py)
    walking: Literal[True] | None  # people
    guarded: Literal[True] | None  # the protective field
    erring: Literal[True] | None  # bodies differ from their plans (deviation.py)

    @classmethod
    def of(cls, config: EnvConfig) -> Self:
        """Return the features of a config."""
        field, stopping = config.traffic_spec.shield, config.arrival != "pass"
        has = (config.action_type != "raw", stopping, config.people > 0, field, deviation.errs(config))
        return cls(*(True if one else None for one in has))


class Worlds(NamedTuple):
    """The arrays of B worlds of N robots and M people."""

    robots: NDArray[np.void]  # ROBOT[B, N], as planned
    routes: Floats  # [B, N, R, 2] [m]
    arcs: Floats  # [B, N, ARCS, 2], their manoeuvres (manoeuvre.py)
    commands: Floats  # [S, B, N, 2], the latest first: speed [m/s] and offset [m], or raw acceleration, steering rate
    persons: NDArray[np.void]  # PERSON[B, M]
    ways: Floats  # [B, M, H, W], see people.People
    limits: NDArray[np.void] | None  # PARAMETERS[B, N], of robots under loads (tasks/shifts.py)
    actual: NDArray[np.void]  # BODY[B, N] of bodies that err, and
    errors: NDArray[Any]  # their errors (deviation.py)
    stamps: NDArray[np.int32]  # [B, N, K, 2], see contact_episodes.judge_pairs
    steps: NDArray[np.int64]  # [B], since the reset
    truncated: NDArray[np.bool_]  # [B]
    terminated: NDArray[np.bool_]  # [B, N]
    waiting: NDArray[np.int32]  # [B], arrivals; these worlds are observed after the Simulator has assigned new tasks
    paths: Floats  # [B, N + 1, POSES, COLUMNS], kept from one decision to the next (traffic/path_ahead.py)
    choices: Floats  # [B, N, K, 3], see senses/preferences.py
    observation: Floats  # [B, N, D]
    terms: Floats  # [B, N, T], of the reward
    reward: Floats  # [B, N]


class Vehicles(NamedTuple):
    """The parameters of the robots."""

    shared: NDArray[np.void]  # PARAMETERS[1]
    kinds: NDArray[np.void] | None  # PARAMETERS[N], where there are several kinds (kinds.py)


class Equipment(NamedTuple):
    """Sensors, rewards, passages and zones."""

    starts: Starts  # of the slices of an observation
    rays: Floats  # [2, R], unit vectors in the robot's frame
    table: Floats | None  # [K, A, 2], the commands of each kind of robots, for predictions
    weights: Floats  # [T], of the reward's terms
    zones: Zones | None
    passages: Passages | None  # for predictions


class Setup(NamedTuple):
    """Arguments that stay the same from step to step."""

    features: Features
    equipment: Equipment
    planned: Vehicles  # of the robots as planned
    bodies: Vehicles  # of their bodies (deviation.py)
    floor: Floor


class Scratch(NamedTuple):
    """Arrays that the step of a world writes before it reads them."""

    places: Any  # buckets.scratch
    motions: Any  # contact.scratch
    near: NDArray[np.int64]  # [1], number of pairs of robots that may meet
    guards: Any  # shield.scratch
    own: Floats  # the motions of the bodies, where these err (deviation.py); else those of `motions`
    sights: plans.Sights
    order: NDArray[np.int32]  # [N], robots by right of way
    found: NDArray[np.int64]  # waits.scratch
    meetings: Any  # reservations.scratch


def make_scratch(setup: Setup, count: int, decides: bool) -> Scratch:
    """Return scratch for worlds of `count` robots; decides: whether there is right of way."""
    p, motions = setup.bodies.shared[0], contact.scratch(count, setup.planned.shared[0])
    table, passages = setup.equipment.table, setup.equipment.passages
    commands, aisles = (0, 0) if table is None or passages is None else (table.shape[1], len(passages.blind))
    sights = plans.make_sights(count, p["rays"], p["neighbours"], commands, aisles)
    return Scratch(
        buckets.scratch(count, p), motions, np.empty(1, np.int64), shield.scratch(count, setup.planned.shared[0]),
        np.empty_like(motions[1]) if setup.features.erring else motions[1], sights, np.empty(count, np.int32),
        waits.scratch(count), reservations.scratch(count if decides else 0),
    )  # fmt: skip


class ThreadScratch(threading.local):
    """The scratch of each thread, made when it first asks."""

    def __init__(self, make_step: Callable[[], Scratch], make_search: Callable[[], Any]) -> None:
        self._make_step, self._make_search = make_step, make_search

    @cached_property
    def step(self) -> Scratch:
        """Return the scratch of a step."""
        return self._make_step()

    @cached_property
    def search(self) -> Any:
        """Return the scratch of a search for manoeuvres (driver/scratch.py)."""
        return self._make_search()
