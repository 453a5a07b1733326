"""Results equal the recorded ones: a kept episode replays to the bit, and all cases give the same digests."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tests.simulation.golden import CASES, COUNTERS, DIGESTS, EPISODE, STACKS, digest, drive_stack
from warehouse_env.simulation.record.recording import Episode
from warehouse_env.simulation.state import field_of

RECORDED = json.loads(DIGESTS.read_text(encoding="utf-8"))


def test_a_kept_episode_replays_to_the_bit() -> None:
    episode = Episode.load(EPISODE)
    for step, (simulator, recorded) in enumerate(zip(episode.replay(), episode.pose, strict=True)):
        assert simulator.state.pose.tobytes() == recorded.tobytes(), f"step {step}"
    totals = {counter: int(np.sum(field_of(simulator.robots, counter))) for counter in COUNTERS}
    assert totals["goals"] + totals["hits_robot"] + totals["hits_shelf"] > 3  # or it would say little


# Each compiles a step that no other test uses.
AT_NIGHT = dict.fromkeys(("pillars, raw", "shielded, 32 on single_lane, people"), pytest.mark.nightly)


@pytest.mark.parametrize("name", [pytest.param(name, marks=AT_NIGHT.get(name, ())) for name in CASES])
def test_the_digest_is_the_recorded_one(name: str) -> None:
    assert digest(CASES[name]) == RECORDED[name]


@pytest.mark.parametrize("name", [pytest.param(name, marks=AT_NIGHT.get(name, ())) for name in STACKS])
def test_a_stack_gives_the_recorded_digest(name: str) -> None:
    found, _, counts = drive_stack(name)
    assert counts["goals"] > 10  # or it would say little
    assert counts["reroutes"] > 10
    assert found == RECORDED[name]


def test_digests_tell_one_case_from_another() -> None:
    assert set(RECORDED) == set(CASES) | set(STACKS)
    assert len(set(RECORDED.values())) == len(RECORDED)
