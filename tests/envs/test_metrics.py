"""Test that PettingZoo, Gymnasium and stable-baselines3 give the same episode metrics and path lengths."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from stable_baselines3 import PPO
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.logger import configure

from warehouse_env import EnvConfig, MetricsCallback, parallel_env, single_env, vec_env

Info = dict[str, Any]

MODES: dict[str, dict[str, Any]] = {
    "lifelong": {"max_steps": 150, "people": 20},
    "one_shot": {"tasks": "one_shot", "max_steps": 400},
    "until_collision": {"terminate_on_collision": True, "layout": "narrow", "num_agents": 8, "max_steps": 120},
}


@pytest.fixture(params=MODES)
def mode(request: pytest.FixtureRequest, tiny: EnvConfig) -> EnvConfig:
    """Return an episode in which all robots end at once, or each by arrival or by collision."""
    return tiny.replace(**MODES[request.param])


def zoo(config: EnvConfig, seed: int) -> dict[int, list[Info]]:
    """Return the infos of every cruising robot in PettingZoo."""
    env = parallel_env(config)
    env.reset(seed=seed)
    infos: dict[int, list[Info]] = {k: [] for k in range(config.num_agents)}
    while env.agents:
        given = env.step(dict.fromkeys(env.agents, env.simulator.cruise_action))[4]
        for agent, info in given.items():
            infos[int(agent.removeprefix("robot_"))].append(info)
    return infos


def single(config: EnvConfig, seed: int) -> list[Info]:
    """Return the infos of robot 0 in Gymnasium while all robots cruise."""
    env = single_env(config)
    env.reset(seed=seed)
    infos, over = [], False
    while not over:
        _, _, terminated, truncated, info = env.step(env.simulator.cruise_action)
        infos.append(info)
        over = terminated or truncated
    return infos


def rows(config: EnvConfig, seed: int) -> dict[int, list[Info]]:
    """Return the infos of every cruising robot in the VecEnv until its end, without padding."""
    env = vec_env(1, config)
    env.seed(seed)
    env.reset()
    cruise = np.stack([env.get_attr("cruise_action")[0]] * config.num_agents)
    infos: dict[int, list[Info]] = {k: [] for k in range(config.num_agents)}
    over = np.zeros(config.num_agents, dtype=bool)
    while not over.all():
        _, _, dones, given = env.step(cruise)
        for row in np.flatnonzero(~over):
            infos[int(row)].append(given[row])
        for row in np.flatnonzero(over):
            assert given[row] == {"padding": True}
        over |= dones
    return infos


def test_all_adapters_agree_on_metrics(mode: EnvConfig) -> None:
    in_zoo, in_rows, alone = zoo(mode, 2), rows(mode, 2), single(mode, 2)
    lengths = {len(infos) for infos in in_zoo.values()}
    assert (len(lengths) > 1) == (mode.tasks == "one_shot" or mode.terminate_on_collision), "this tests too little"
    for robot, infos in in_zoo.items():
        assert [k for k, info in enumerate(infos) if "episode_metrics" in info] == [len(infos) - 1]
        assert in_rows[robot][-1]["episode_metrics"] == infos[-1]["episode_metrics"]
        assert in_rows[robot][-1]["episode"]["l"] == len(infos) == len(in_rows[robot])
        for mine, row in zip(infos, in_rows[robot], strict=True):
            for name in ("path_length_m", "planned_length_m"):
                assert (name in mine) == (name in row) == bool(mine["goals"])
                assert mine.get(name) == row.get(name)
    assert alone == in_zoo[0]


def test_metrics_are_sums_of_infos(mode: EnvConfig) -> None:
    seen: dict[str, float] = {}
    for infos in zoo(mode, 4).values():
        metrics = infos[-1]["episode_metrics"]
        totals = ("distance_m", "goals", "collisions_robot", "collisions_shelf", "collisions_person", "near_misses")
        for name in totals:
            assert metrics[name] == pytest.approx(sum(info[name] for info in infos), rel=1e-6)
            seen[name] = seen.get(name, 0.0) + metrics[name]
        assert metrics["seconds"] == pytest.approx(0.1 * len(infos))
        gap = min(info["gap"] for info in infos)
        assert metrics.get("min_clearance_m") == (gap if gap < 0.5 else None)
        tasks = [info for info in infos if "path_length_m" in info]
        driven, planned = (sum(info[name] for info in tasks) for name in ("path_length_m", "planned_length_m"))
        assert len(tasks) == metrics["goals"]
        if tasks:
            assert metrics["path_length_m"] == pytest.approx(driven / len(tasks))
            assert metrics["path_length_ratio"] == pytest.approx(driven / planned)
        else:
            assert not metrics.keys() & {"path_length_m", "path_length_ratio"}
    assert seen["distance_m"] > 0
    assert seen["goals"] > 0 or mode.terminate_on_collision
    assert seen["collisions_robot"] + seen["collisions_shelf"] > 0 or not mode.terminate_on_collision
    assert (seen["collisions_person"] > 0) == (mode.people > 0)


def logged(model: BaseAlgorithm, folder: Path) -> list[dict[str, float]]:
    """Close the logger; return the rows of stable-baselines3's progress.csv without empty cells."""
    model.logger.close()
    with (folder / "progress.csv").open() as file:
        return [{name: float(cell) for name, cell in row.items() if cell} for row in csv.DictReader(file)]


def test_callback_logs_the_infos(tiny: EnvConfig, tmp_path: Path) -> None:
    configs = [tiny, tiny.replace(tasks="one_shot", max_steps=150)]
    model = PPO("MlpPolicy", vec_env(2, configs=configs), n_steps=40, batch_size=80, n_epochs=1, seed=0, device="cpu")
    model.set_logger(configure(str(tmp_path), ["csv"]))
    seen: list[list[dict[str, float]]] = []

    class Spy(MetricsCallback):
        def _on_rollout_start(self) -> None:
            seen.append([])

        def _on_step(self) -> bool:
            seen[-1].extend(info["episode_metrics"] for info in self.locals["infos"] if "episode_metrics" in info)
            return super()._on_step()

    model.learn(4 * 40 * 12, callback=Spy())
    rows = logged(model, tmp_path)
    assert len(rows) == len(seen) == 4
    for row, episodes in zip(rows, seen, strict=True):
        assert len(episodes) >= 18  # 40 steps end at least three episodes of 6 robots
        names = {name for episode in episodes for name in episode}
        assert {f"robot/{name}" for name in names} == {name for name in row if name.startswith("robot/")}
        for name in names:
            mean = float(np.mean([episode[name] for episode in episodes if name in episode]))
            assert row[f"robot/{name}"] == pytest.approx(mean, rel=1e-6, abs=1e-9)
        assert row["world/robot_km"] > 0
