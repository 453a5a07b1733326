"""The same seed gives the same bits: for any batch width, thread count, process, and without the compiler."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.simulation.worlds import drawn, room
from warehouse_env.config import EnvConfig, SensorSpec
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.simulation import simulator
from warehouse_env.simulation.physics import buckets
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.state import OWNER, field_of
from warehouse_env.threads import MOST_THREADS, get_num_threads, set_num_threads

ROOT = Path(__file__).parents[2]
MAP = ["..........", "..........", ".##..###..", "..........", ".###..##..", "..........", ".##.##.#..", ".........."]
ACTION_TYPES = ("discrete", "continuous", "raw")


def actions_for(action_type: str, steps: int, worlds: int, robots: int, seed: int = 9) -> NDArray[Any]:
    """The same numbers for world b whatever the number of worlds."""
    rng = np.random.default_rng(seed)
    if action_type == "discrete":  # mostly ahead, so that robots get about and meet
        return rng.choice([0, 5, 10, 15, 16, 17], (steps, 64, robots), p=[0.05, 0.05, 0.1, 0.6, 0.1, 0.1])[:, :worlds]
    return rng.uniform(-0.6, 1.0, (steps, 64, robots, 2)).astype(np.float32)[:, :worlds]


def bits(simulator: Simulator) -> list[bytes]:
    """All that a step gave, of each world apart."""
    return [
        simulator.observation[b].tobytes()
        + simulator.reward[b].tobytes()
        + simulator.reward_terms[b].tobytes()
        + b"".join(np.ascontiguousarray(field_of(simulator.robots[b], name)).tobytes() for name in OWNER)
        for b in range(simulator.num_worlds)
    ]


def run(worlds: int, steps: int, robots: int, action_type: Any, grid: GridMap, **changes: Any) -> list[str]:
    """A digest of each world's whole history."""
    settings = {"action_repeat": 2, "planner": "astar"} | changes
    config = EnvConfig(num_agents=robots, action_type=action_type, **settings)
    simulator = Simulator(config, worlds, grid=grid)
    simulator.reset(seed=4)
    digests = [hashlib.blake2b(first) for first in bits(simulator)]
    for actions in actions_for(action_type, steps, worlds, robots):
        simulator.step(actions)
        for digest, now in zip(digests, bits(simulator), strict=True):
            digest.update(now)
    assert simulator.state.distance.min() > 0
    if robots > 4:  # or comparing them would say little about contacts
        assert simulator.robots["totals"]["hits_robot"].sum() > 0
    return [digest.hexdigest() for digest in digests]


LEAN = SensorSpec(rays=8, neighbours=1, route_points=2)


@pytest.mark.parametrize("action_type", ACTION_TYPES)
def test_worlds_do_not_depend_on_the_batch_width(action_type: str) -> None:
    steps = 1000 if action_type == "discrete" else 200
    alone, seven, many = (run(b, steps, 2, action_type, drawn(MAP), sensor=LEAN) for b in (1, 7, 64))
    assert len(set(many)) == 64
    assert alone == many[:1]
    assert seven == many[:7]


@pytest.mark.parametrize("rules", [{}, {"traffic": "rules"}])
def test_one_thread_equals_two(rules: dict[str, bool], monkeypatch: pytest.MonkeyPatch) -> None:
    before = get_num_threads()
    if MOST_THREADS < 2:
        pytest.skip("one thread only")
    results = []
    sensor = SensorSpec(predictions=True)
    try:
        for threads, parallel_from in ((1, 1), (2, 1), (2, 10**9)):
            set_num_threads(threads)
            monkeypatch.setattr(simulator, "PARALLEL_FROM", parallel_from)
            results.append(run(9, 150, 4, "discrete", drawn(MAP), sensor=sensor, **rules))
    finally:
        set_num_threads(before)
    assert results[0] == results[1] == results[2]


def test_worlds_do_not_depend_on_the_parts_in_which_they_are_stepped(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = run(7, 150, 4, "discrete", drawn(MAP), sensor=LEAN)
    monkeypatch.setattr(simulator, "_MOST", 8)
    made = Simulator(EnvConfig(num_agents=4, planner="astar"), 7, grid=drawn(MAP))
    assert made._blocks == [(0, 2), (2, 4), (4, 6), (6, 7)]
    assert run(7, 150, 4, "discrete", drawn(MAP), sensor=LEAN) == whole


def test_many_robots_take_the_threads_by_themselves() -> None:
    if get_num_threads() < 2:
        pytest.skip("one thread only")
    large = Simulator(EnvConfig(num_agents=4, planner="astar"), 64, grid=room(9, 9))
    small = Simulator(EnvConfig(num_agents=4, planner="astar"), 63, grid=room(9, 9))
    assert large._many()
    assert not small._many()


def test_a_list_of_seeds_gives_single_worlds() -> None:
    config = EnvConfig(num_agents=3, planner="astar", action_repeat=2)
    batch = Simulator(config, 3, grid=drawn(MAP))
    batch.reset(seed=[11, 12, 11])
    for world, seed in enumerate((11, 12, 11)):
        alone = Simulator(config, grid=drawn(MAP))
        alone.reset(seed=seed)
        assert bits(alone)[0] == bits(batch)[world]
    assert bits(batch)[0] != bits(batch)[1]


def test_resetting_one_world_leaves_the_others_alone() -> None:
    config = EnvConfig(num_agents=3, planner="astar", action_repeat=2)
    actions = actions_for("discrete", 60, 3, 3)
    one, other = (Simulator(config, 3, grid=drawn(MAP)) for _ in range(2))
    for batch in (one, other):
        batch.reset(seed=6)
        for k in range(30):
            batch.step(actions[k])
    one.reset_world(1, seed=21)
    fresh = Simulator(config, grid=drawn(MAP))
    fresh.reset(seed=21)
    assert bits(one)[1] == bits(fresh)[0]
    assert one.steps.tolist() == [30, 0, 30]
    for k in range(30, 60):
        one.step(actions[k])
        other.step(actions[k])
        fresh.step(actions[k, 1:2])
        assert [bits(one)[b] for b in (0, 2)] == [bits(other)[b] for b in (0, 2)]
        assert bits(one)[1] == bits(fresh)[0]


def test_a_reset_leaves_nothing_behind() -> None:
    config = EnvConfig(num_agents=4, planner="astar", action_repeat=2, tasks="one_shot", terminate_on_collision=True)
    used, fresh = (Simulator(config, 2, grid=drawn(MAP)) for _ in range(2))
    used.reset(seed=1)
    for actions in actions_for("discrete", 120, 2, 4):
        used.step(actions)
    assert used.terminated.any()
    used.reset(seed=2)
    fresh.reset(seed=2)
    assert not used.terminated.any()
    for actions in actions_for("discrete", 60, 2, 4, seed=1):
        assert bits(used) == bits(fresh)
        used.step(actions)
        fresh.step(actions)


def test_without_a_seed_each_world_goes_on_with_its_own() -> None:
    config = EnvConfig(num_agents=3, planner="astar", action_repeat=2)
    one, other = (Simulator(config, 2, grid=drawn(MAP)) for _ in range(2))
    for batch in (one, other):
        batch.reset(seed=3)
    first = bits(one)
    one.reset()
    other.reset()
    assert bits(one) == bits(other)
    assert bits(one) != first


PROGRAM = """
import sys
sys.path.insert(0, {root!r})
from tests.simulation.test_determinism import MAP, SensorSpec, drawn, run
for action_type in {types!r}:
    print(*run({worlds}, {steps}, {robots}, action_type, drawn(MAP), sensor=SensorSpec(predictions=True)))
"""


def elsewhere(worlds: int, steps: int, robots: int, **environment: str) -> list[list[str]]:
    """The digests that another process finds."""
    program = PROGRAM.format(root=str(ROOT), types=ACTION_TYPES, worlds=worlds, steps=steps, robots=robots)
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", program],
        env=os.environ | environment,
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return [line.split() for line in done.stdout.splitlines()]


def test_another_process_gives_the_same_bits() -> None:
    sensor = SensorSpec(predictions=True)
    here = [run(3, 200, 3, action_type, drawn(MAP), sensor=sensor) for action_type in ACTION_TYPES]
    assert elsewhere(3, 200, 3) == here


def test_plain_python_gives_the_same_bits() -> None:
    sensor = SensorSpec(predictions=True)
    here = [run(1, 30, 9, action_type, drawn(MAP), sensor=sensor) for action_type in ACTION_TYPES]
    assert elsewhere(1, 30, 9, NUMBA_DISABLE_JIT="1") == here


def permuted(original: Simulator, order: NDArray[np.int64]) -> Simulator:
    """A simulator whose robot k is the original's robot order[k]."""
    copy = Simulator(original.config, grid=original.grid, routes=original.route_book)
    copy.reset(seed=0)
    copy.dispatcher.routes = original.routes[:, order].copy()
    copy.robots[...] = original.robots[:, order]
    copy._bind()
    copy._observe()
    return copy


@pytest.mark.parametrize("action_type", ACTION_TYPES)
@pytest.mark.parametrize("robots", [7, 36])
def test_permuted_robots_give_permuted_results(action_type: Any, robots: int) -> None:
    # One-shot, since lifelong robots draw their next goals in their order.
    config = EnvConfig(num_agents=robots, action_type=action_type, planner="astar", action_repeat=2, tasks="one_shot")
    original = Simulator(config, grid=room(7, 7) if robots == 7 else room(20, 20))
    original.reset(seed=13)
    order = np.random.default_rng(1).permutation(robots)
    shuffled = permuted(original, order)
    total = 0
    for actions in actions_for(action_type, 120, 1, robots):
        for name in OWNER:
            ours, theirs = field_of(shuffled.robots[0], name), field_of(original.robots[0], name)[order]
            np.testing.assert_array_equal(ours, theirs, err_msg=name)
        np.testing.assert_array_equal(shuffled.observation[0], original.observation[0][order])
        np.testing.assert_array_equal(shuffled.reward[0], original.reward[0][order])
        np.testing.assert_array_equal(shuffled.terminated[0], original.terminated[0][order])
        original.step(actions)
        shuffled.step(actions[:, order])
        total += int(original.events.hit_robot.sum())
    assert total > 0


@pytest.mark.parametrize("action_type", ["discrete", "raw"])
@pytest.mark.parametrize("robots", [12, 40])
def test_buckets_change_nothing(action_type: Any, robots: int, monkeypatch: pytest.MonkeyPatch) -> None:
    config = EnvConfig(num_agents=robots, action_type=action_type, planner="astar", action_repeat=2)
    pair = []
    for few in (0, 10**6):
        monkeypatch.setattr(buckets, "FEW", few)
        pair.append(Simulator(config, 2, grid=room(16, 24)))
        pair[-1].reset(seed=8)
        # off the cells' centres, where equally near neighbours are common and may come in either order
        pair[-1].robots["motion"]["x"] += np.random.default_rng(0).uniform(0, 0.02, (2, robots))
        pair[-1]._observe()
    assert pair[0]._params["bucket_rows"][0] > 3
    assert pair[1]._params["bucket_rows"][0] == 1
    for actions in actions_for(action_type, 150, 2, robots):
        assert bits(pair[0]) == bits(pair[1])
        for one in pair:
            one.step(actions)
    assert pair[0].robots["totals"]["hits_robot"].sum() > 0
