"""The fixed set: floors, fleets, seeds and tracks that every entry drives. A change of any is another version."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from agents import make_policy
from train.central import CENTRAL
from train.evaluation.rollout import Experiment, config_of, make_experiment
from warehouse_env.config import EnvConfig
from warehouse_env.errors import WeightsError
from warehouse_env.maps.layouts import make_layout
from warehouse_env.traffic_spec import TRAFFIC

VERSION = 1
SECONDS = 600.0  # of an episode
SEED = 50_000_000  # of the first episode of each case: from here on nothing may be trained or chosen on
PLANNER = "pf_aco"


class Case(NamedTuple):
    """A floor with its robots; what is reported together is a group."""

    group: str
    layout: str
    robots: int
    episodes: int


class Track(NamedTuple):
    """How all entries drive, and the switches as the hash of the set has them, by the names of its first day."""

    summary: str
    hashed: dict[str, Any]


CASES: tuple[Case, ...] = (
    *(Case(f"named, {n}", layout, n, 3) for n in (32, 64) for layout in ("paper46", "narrow")),
    Case("named, 128", "paper46", 128, 2),
    *(Case(f"drawn, {n}", f"aisles:seed={seed}", n, 1) for n in (32, 64) for seed in range(801, 813)),
    Case("large, 256", "blocks:rows=92,columns=92", 256, 2),
)
FIELD = "field"
TRACKS: dict[str, Track] = {
    FIELD: Track(
        "under the protective field, with right of way and live routes",
        {"protective_field": True, "right_of_way": True, "reroute": True},
    ),
    "bare": Track(
        "with live routes alone: nothing keeps robots off each other but the policy",
        {"protective_field": False, "right_of_way": False, "reroute": True},
    ),
}
_BODIES = ("robot", "time_step", "substeps", "arrival_radius", "near_miss_gap", "keep_right")


def options(policy: str, track: str) -> dict[str, Any]:
    """Return the fields of EnvConfig that are set against a policy's own on a track.

    Right of way, where the track has it, steps in when the policy asks for it, or else as "assist" says. Raw actions
    follow no route, so there is no right of way for them.
    """
    own = config_of(policy, EnvConfig(), {})
    if track != FIELD:
        return {"traffic": "routes"}
    if own.action_type == "raw":
        return {"traffic": "shield"}
    return {"traffic": "own:shield=true,routes=true" if own.traffic_spec.right_of_way else "assist"}


def tracks(policy: str) -> list[str]:
    """Return the tracks that a policy can drive on: who was trained under the field is not made for going without."""
    found = []
    for track in TRACKS:
        try:
            if policy not in CENTRAL:
                make_policy(policy, config_of(policy, EnvConfig(), options(policy, track)))
        except WeightsError:
            if track == FIELD:
                raise
            continue
        found.append(track)
    return found


def experiments(policy: str, cases: Sequence[Case] = CASES) -> Iterator[tuple[str, Experiment]]:
    """Yield the track and the experiment of each case; errors as of `make_experiment`."""
    for track in tracks(policy):
        chosen = options(policy, track)
        for number, case in enumerate(cases):
            base = EnvConfig(layout=case.layout, num_agents=case.robots, planner=PLANNER)
            yield track, make_experiment(policy, base, case.episodes, SECONDS, SEED + 1000 * number, chosen)


def set_hash(cases: Sequence[Case] = CASES) -> str:
    """Return 16 hex digits for the whole set, with the floors cell by cell and what robots are."""
    content = hashlib.sha256()
    defaults = EnvConfig().to_dict()
    bodies = {name: defaults[name] for name in _BODIES}
    del bodies["robot"]["mass"]  # of no effect here, where nobody carries anything
    assist = TRAFFIC["assist"]
    bodies["field_margin"] = assist.margin
    said = [VERSION, SECONDS, SEED, PLANNER, assist.right_of_way_after, cases, TRACKS, bodies]
    content.update(json.dumps(said, sort_keys=True).encode())
    for layout in dict.fromkeys(case.layout for case in cases):
        grid = make_layout(layout)
        picks, stations, _ = grid.endpoints
        content.update(grid.occupied.tobytes() + json.dumps([picks, stations]).encode())
    return content.hexdigest()[:16]
