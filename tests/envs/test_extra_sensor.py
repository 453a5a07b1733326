"""Test that a user's sensor fills its own slice in every adapter and changes nothing else."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from unittest import mock

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.envs.conftest import Compass
from warehouse_env import EnvConfig, SensorSpec, Simulator, parallel_env, tensor_env, vec_env
from warehouse_env.errors import ConfigError
from warehouse_env.observation import SENSORS
from warehouse_env.simulation.senses.extra import SensorView
from warehouse_env.traffic_spec import UncertaintySpec

PLAIN = EnvConfig(layout="open", num_agents=3, max_steps=25, planner="astar", traffic="shield")
CONFIG = PLAIN.replace(sensor=SensorSpec(extra="compass:noise=0"), uncertainty=UncertaintySpec(pose_error=0.1))


@pytest.fixture(autouse=True)
def compass() -> Iterator[None]:
    with mock.patch.dict(SENSORS, compass=Compass):
        yield


def expected_readings(simulator: Simulator) -> NDArray[np.float32]:
    """Return the expected readings of a compass without noise."""
    x, _, heading = np.moveaxis(simulator.state.pose, -1, 0)
    return np.stack([np.cos(heading), np.sin(heading), x / 40], axis=-1)


def test_sensor_changes_only_its_own_slice() -> None:
    simulator, without = Simulator(CONFIG, 3), Simulator(CONFIG.replace(sensor=SensorSpec()), 3)
    part, rng = simulator.layout.slices["extra"], np.random.default_rng(0)
    assert part.stop == simulator.layout.slices["field"].start  # policies without the shield read only up to here
    assert simulator.grid.shape[1] * simulator.grid.cell_size == 40
    simulator.reset(5)
    without.reset(5)
    for step in range(30):
        np.testing.assert_allclose(simulator.observation[..., part], expected_readings(simulator), atol=1e-6)
        rest = np.delete(simulator.observation, part, axis=-1)
        np.testing.assert_array_equal(rest, without.observation)
        if step % 9 == 8:
            before = simulator.observation.copy()
            for one in (simulator, without):
                one.reset_worlds([2, 0])
            np.testing.assert_array_equal(simulator.observation[1], before[1])
        else:
            actions = rng.integers(20, size=(3, 3))
            for one in (simulator, without):
                one.step(actions)


def test_noise_does_not_depend_on_batch_or_copy() -> None:
    noisy = CONFIG.replace(sensor=SensorSpec(extra="compass"))
    wide, alone = Simulator(noisy, 3), Simulator(noisy)
    wide.reset([7, 8, 9])
    alone.reset(8)
    actions = np.full((1, 3), wide.cruise_action)
    for simulator in (wide, copy.deepcopy(wide)):
        one = copy.deepcopy(alone)
        for _ in range(5):
            one.step(actions)
            simulator.step(np.repeat(actions, 3, axis=0))
            np.testing.assert_array_equal(simulator.observation[1], one.observation[0])
        assert not np.allclose(simulator.observation[1], simulator.observation[2])


def test_rows_and_last_observations_include_the_sensor() -> None:
    worlds, robots = vec_env(2, CONFIG), parallel_env(CONFIG)
    worlds.seed(3)
    rows, (seen, _) = worlds.reset(), robots.reset(seed=3)
    part = worlds.blocks[0].simulator.layout.slices["extra"]
    for _ in range(CONFIG.max_steps):
        np.testing.assert_array_equal(rows[:3], np.stack(list(seen.values())))
        rows, _, done, infos = worlds.step(np.full(6, 17))
        seen = robots.step(dict.fromkeys(robots.agents, 17))[0]
    assert done.all()
    for info, now, last in zip(infos, rows, seen.values(), strict=False):
        np.testing.assert_array_equal(info["terminal_observation"], last)
        assert not np.allclose(last[part], now[part])


def test_sensor_is_created_only_on_demand_and_refused_on_devices(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ConfigError, match="a device does not simulate extra sensors"):
        tensor_env(2, CONFIG.replace(traffic="none"), device="cpu")
    monkeypatch.setattr("warehouse_env.simulation.simulator.ExtraSensor", None)  # raises if it is created
    simulator = Simulator(PLAIN)
    simulator.reset(0)
    simulator.step(np.full((1, 3), simulator.cruise_action))


def test_sensor_gets_only_the_requested_worlds() -> None:
    views: list[SensorView] = []

    class RecordingCompass(Compass):
        def observe(self, view: SensorView) -> NDArray[np.float32]:
            views.append(view._replace(steps=view.steps.copy()))
            return super().observe(view)

    with mock.patch.dict(SENSORS, compass=RecordingCompass):
        simulator = Simulator(CONFIG, 4)
    simulator.reset(1)
    simulator.step(np.full((4, 3), simulator.cruise_action))
    simulator.reset_world(2)
    assert [view.steps.tolist() for view in views] == [[0] * 4, [1] * 4, [0]]
    for view in views:
        worlds = len(view.steps)
        assert {len(part) for part in (view.routes, view.persons, view.keys, *view.state)} == {worlds}
    np.testing.assert_array_equal(views[-1].state.pose[0], simulator.state.pose[2])
