"""The same seed gives the same bits for any batch width, threads and order of robots; draws are the published ones."""

from __future__ import annotations

import hashlib
import itertools
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.simulation.worlds import drawn, room
from warehouse_env.config import EnvConfig, SensorSpec
from warehouse_env.kernel import kernel
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.simulation import draws, simulator
from warehouse_env.simulation.draws import Draws, below, philox, shuffle
from warehouse_env.simulation.physics import buckets
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.state import OWNER, field_of
from warehouse_env.threads import MOST_THREADS, get_num_threads, set_num_threads
from warehouse_env.traffic_spec import UncertaintySpec

KEY = np.array([0xA4093822, 0x299F31D0, 0], dtype=np.uint64)


@kernel
def answer(counter, key):  # type: ignore[no-untyped-def]
    return philox(counter[0], counter[1], counter[2], counter[3], key[0], key[1])


# Random123's kat_vectors for philox4x32 with 10 rounds: counter, key, answer
PUBLISHED = (
    ("00000000 00000000 00000000 00000000", "00000000 00000000", "6627e8d5 e169c58d bc57ac4c 9b00dbd8"),
    ("ffffffff ffffffff ffffffff ffffffff", "ffffffff ffffffff", "408f276d 41c83b0e a20bc7c6 6d5451fd"),
    ("243f6a88 85a308d3 13198a2e 03707344", "a4093822 299f31d0", "d16cfe09 94fdcceb 5001e420 24126ea1"),
)


@pytest.mark.parametrize("published", PUBLISHED)
def test_the_words_are_the_published_ones(published: tuple[str, str, str]) -> None:
    counter, key, wanted = (np.array([int(word, 16) for word in line.split()], np.uint64) for line in published)
    assert answer(counter, key) == tuple(wanted.tolist())


def test_numbers_are_even_and_below_their_bound() -> None:
    drawn = [below(KEY, draws.GOAL, robot, number, 0, 7) for robot in range(100) for number in range(70)]
    counts = np.bincount(drawn, minlength=7)
    assert len(counts) == 7
    assert np.abs(counts - 1000).max() < 110  # 3.8 standard deviations


def test_each_part_of_a_counter_and_of_a_key_matters() -> None:
    ways = itertools.product(range(2), range(8), range(3), range(3), range(3))
    seen = {below(KEY + np.array([0, 0, e], np.uint64), *rest, 2**32 - 1) for e, *rest in ways}
    assert len(seen) == 2 * 8 * 27
    other = KEY + np.array([1, 0, 0], np.uint64)
    assert below(other, 0, 0, 0, 0, 2**32 - 1) not in seen


def test_a_permutation_has_each_number_once_and_all_places_alike() -> None:
    first = np.empty((2000, 5), np.int32)
    for e, order in enumerate(first):
        shuffle(KEY + np.array([0, 0, e], np.uint64), draws.START, order)
    assert all(sorted(order) == [0, 1, 2, 3, 4] for order in first.tolist())
    assert np.abs(np.mean(first, axis=0) - 2.0).max() < 0.13  # 4 standard deviations


def test_a_seed_gives_its_episodes_again_and_an_unseeded_world_its_own() -> None:
    one, other, free = Draws(2), Draws(1), [Draws(1) for _ in range(2)]
    episodes = []
    for entropy in ([5, 0], None, None, [5, 0]):
        one.begin(0, entropy)
        episodes.append(one.keys[0].tolist())
    assert episodes[0] == episodes[3]
    assert len(set(map(tuple, episodes))) == 3
    other.begin(0, [5, 1])
    assert other.keys[0].tolist() != episodes[0]
    for draw in free:
        draw.begin(0, None)
    assert free[0].keys.tolist() != free[1].keys.tolist()


MAP = ["..........", "..........", ".##..###..", "..........", ".###..##..", "..........", ".##.##.#..", ".........."]


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


@pytest.mark.parametrize("action_type", ["discrete", "continuous"])
def test_worlds_do_not_depend_on_the_batch_width(action_type: str) -> None:
    steps = 200
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


@pytest.mark.parametrize("changes", [{"uncertainty": UncertaintySpec(loss=0.4)}, {"people": 4}])
def test_tasks_are_those_of_the_seed_whatever_else_is_drawn(changes: dict[str, Any]) -> None:
    config, found = EnvConfig(num_agents=5, planner="astar", action_repeat=2), []
    for own in (config, config.replace(**changes)):
        simulator = Simulator(own, grid=room(16, 10))
        simulator.reset(3)
        found.append((simulator.state.pose.tolist(), simulator.state.goal.tolist()))
    assert found[0] == found[1]


def permuted(original: Simulator, order: NDArray[np.int64]) -> Simulator:
    """A simulator whose robot k is the original's robot order[k]."""
    copy = Simulator(original.config, grid=original.grid, routes=original.route_book)
    copy.reset(seed=0)
    copy.dispatcher.routes = original.routes[:, order].copy()
    copy.robots[...] = original.robots[:, order]
    copy._bind()
    copy._observe()
    return copy


@pytest.mark.parametrize("action_type", ["discrete", "raw"])
@pytest.mark.parametrize("robots", [7, 36])
def test_permuted_robots_give_permuted_results(action_type: Any, robots: int) -> None:
    # One-shot, since lifelong robots draw their next goals in their order.
    config = EnvConfig(num_agents=robots, action_type=action_type, planner="astar", action_repeat=2, tasks="one_shot")
    original = Simulator(config, grid=room(7, 7) if robots == 7 else room(20, 20))
    original.reset(seed=5)
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


def test_buckets_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    robots = 40
    config = EnvConfig(num_agents=robots, planner="astar", action_repeat=2)
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
    for actions in actions_for("discrete", 150, 2, robots):
        assert bits(pair[0]) == bits(pair[1])
        for one in pair:
            one.step(actions)
    assert pair[0].robots["totals"]["hits_robot"].sum() > 0
