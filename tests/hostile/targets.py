"""All that reads files or takes values from outside, each with what makes hostile inputs for it."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import inspect
import io
import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

import numpy as np

from agents import Network, PolicyRecord
from tests.hostile import making
from tests.hostile.making import damaged, json_bytes, json_lines, options, value
from tests.hostile.readers import HALL, NETWORK, READERS, SMALL, an_episode
from train.commands.bench import Bench
from train.commands.demo import Demo
from train.commands.evaluate import Evaluate
from train.commands.plan import PlanCommand
from train.learning.config import PPOConfig, ReinforceConfig, ThreadedPPOConfig
from train.live.commands import read_command
from warehouse_env.checked import from_plain
from warehouse_env.config import EnvConfig, RewardWeights, RobotSpec, SensorSpec
from warehouse_env.envs.parallel import parallel_env
from warehouse_env.envs.single import single_env
from warehouse_env.envs.vector import vec_env
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.halls.hall import files_of, read_hall
from warehouse_env.maps.halls.lif import write_lif
from warehouse_env.maps.halls.route_graph import write_route_graph
from warehouse_env.maps.halls.saved import write_hall
from warehouse_env.maps.layouts import LAYOUTS, make_layout
from warehouse_env.planning import PLANNERS, make_planner
from warehouse_env.simulation.record.recording import Episode, Recorder
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.tasks.assignment import Assignment
from warehouse_env.traffic_spec import TrafficSpec, UncertaintySpec
from warehouse_env.work import BatterySpec, OrderSpec, ServiceSpec


class Target(NamedTuple):
    """One reader or constructor."""

    make: Callable[[Random], Any]  # an input
    take: Callable[[Any, Path], Any]  # what is tried with it, in a folder that may be written to
    each: int  # inputs of it in a round, the more the faster it is


CONFIGS = (
    EnvConfig, RobotSpec, SensorSpec, TrafficSpec, UncertaintySpec, RewardWeights, BatterySpec, OrderSpec, ServiceSpec,
    ReinforceConfig, PPOConfig, ThreadedPPOConfig,
)  # fmt: skip
LIVE: tuple[dict[str, Any], ...] = (
    {"do": "play", "playing": True}, {"do": "speed", "speed": 2.5}, {"do": "leave", "person": 0},
    {"do": "make", "policy": "greedy", "floor": "open", "robots": 8, "seed": 1},
    {"do": "shelves", "cells": [[1, 2], [3, 4]], "stand": True}, {"do": "person", "cell": [5, 6]},
)  # fmt: skip


def _written(content: bytes, folder: Path, name: str) -> Path:
    path = folder / name
    path.write_bytes(content)
    return path


def _make_hall(rng: Random) -> tuple[dict[str, bytes], str]:
    """Return the files of a hall, some of them hostile, and how it is read."""
    files = dict(HALL)
    for name in rng.sample(sorted(files), rng.randint(1, 2)):
        is_json = name.endswith("json")
        files[name] = json_bytes(rng, json.loads(files[name])) if is_json else damaged(rng, files[name])
    how = rng.choice(["", "cell=0.5", "keepout=k.yaml", "speed=k.yaml", "discs=h.discs.json", "lanes=l.json",
                      "lanes=l.geojson", "lanes=l.json,lanes_only=true", "cell=2", "cell=" + making.text(rng),
                      making.text(rng)])  # fmt: skip
    return files, rng.choice(["h.yaml", "h.yaml", "h.yaml", "h.png"]) + (f":{how}" if how else "")


def _hall(given: tuple[dict[str, bytes], str], folder: Path) -> None:
    for name, content in given[0].items():
        _written(content, folder, name)
    hall = read_hall(f"{folder}/{given[1]}")
    _use(hall.grid)
    list(files_of(f"{folder}/{given[1]}"))
    write_hall(hall.grid, folder / "g.yaml")
    write_lif(hall.grid, folder / "g.json")
    write_route_graph(hall.grid, folder / "g.geojson")


def _use(grid: GridMap) -> None:
    """Ask a floor for all that is worked out when it is first asked for."""
    _ = grid.text(), grid.key, grid.legal_moves, repr(grid), len(grid.free_cells), len(grid.endpoints)


@functools.cache
def _members() -> dict[str, bytes]:
    with zipfile.ZipFile(io.BytesIO(an_episode())) as file:
        return {name: file.read(name) for name in file.namelist()}


def _replayed(content: bytes, folder: Path) -> None:
    for _ in Episode.load(_written(content, folder, "e.npz")).replay():
        pass


def _make_config(rng: Random) -> tuple[type, dict[str, Any]]:
    kind = rng.choice([*CONFIGS, Network, PolicyRecord, Bench, Demo, Evaluate, PlanCommand])
    return kind, options(rng, [*(field.name for field in dataclasses.fields(kind)), "zz"])


def _config(given: tuple[type, dict[str, Any]], folder: Path) -> None:
    kind, parts = given
    needed: dict[Any, dict[str, Any]] = {
        Network: {"observation_size": 3, "actions": 2, "discrete": True},
        PolicyRecord: {"algorithm": "a", "network": NETWORK, "env": EnvConfig()},
    }
    made = from_plain(kind, {**needed.get(kind, {}), **parts})
    hash(made) if kind is not PolicyRecord else repr(made)


def _make_plain(rng: Random) -> tuple[type, bytes]:
    kind = rng.choice(CONFIGS)
    made: Any = kind()
    data = made.to_dict() if hasattr(made, "to_dict") else dataclasses.asdict(made)
    return kind, json_bytes(rng, data)


def _plain(given: tuple[type, bytes], folder: Path) -> None:
    data = None
    with contextlib.suppress(ValueError, RecursionError):
        data = json.loads(given[1])
    made: Any = from_plain(given[0], data)
    text = json.dumps(made.to_dict() if hasattr(made, "to_dict") else dataclasses.asdict(made), allow_nan=False)
    assert from_plain(given[0], json.loads(text)) == made


def _grid(parts: dict[str, Any], folder: Path) -> None:
    _use(GridMap(**{"occupied": np.zeros((4, 5)), **parts}))


def _make_layout(rng: Random) -> tuple[Any, dict[str, Any]]:
    name = rng.choice(sorted(LAYOUTS))
    names = [*inspect.signature(LAYOUTS[name]).parameters, "zz"]
    sized = {rng.choice(names): rng.choice([rng.randrange(60), value(rng)]) for _ in range(rng.randrange(3))}
    words = [f"{name}:{rng.choice(names)}={making.text(rng)}", f"{name}:{rng.choice(names)}={rng.randrange(50)}"]
    return rng.choice([name, name, *words, value(rng)]), sized


def _planned(given: tuple[Any, tuple[Any, Any], dict[str, Any]], folder: Path) -> None:
    make_planner(given[0], **given[2])
    grid = _grids()
    grid.distance_to(given[1][0])
    make_planner("astar").plan(grid, *given[1], np.random.default_rng(0))


@functools.cache
def _grids() -> GridMap:
    return GridMap(np.zeros((4, 5)))


def _make_planned(rng: Random) -> tuple[Any, tuple[Any, Any], dict[str, Any]]:
    known = rng.choice(sorted(PLANNERS))
    fields = [*inspect.signature(PLANNERS[known]).parameters, "zz"]
    name = rng.choice([value(rng), known, known, f"{known}:{making.text(rng)}"])
    ends = tuple(rng.choice([value(rng), (rng.randrange(6), rng.randrange(6))]) for _ in range(2))
    return name, ends, rng.choice([{}, options(rng, fields)])


ENVS = (parallel_env, single_env, vec_env)
FIELDS = [field.name for field in dataclasses.fields(EnvConfig)]
OPTIONS = [*FIELDS, "grid", "config", "render_mode", "num_worlds", "zz"]


def _env(given: tuple[int, dict[str, Any]], folder: Path) -> None:
    make: Any = ENVS[given[0]]
    make(**{**({"num_worlds": 1} if make is vec_env else {}), **SMALL, **given[1]})


@functools.cache
def _envs(action_type: str) -> tuple[Any, ...]:
    config = EnvConfig(action_type=action_type, **SMALL)  # type: ignore[arg-type]
    return parallel_env(config), single_env(config), vec_env(2, config), Simulator(config, 2)


ACTS = ("parallel", "single", "vector", "step", "put", "reset", "reset_world", "seed", "reset_to", "recorder")


def _make_act(rng: Random) -> tuple[str, str, Any]:
    given = value(rng)
    if rng.random() < 0.3:
        shape = tuple(rng.choice([0, 1, 2, 2, 3, 20]) for _ in range(rng.randint(1, 4)))
        with np.errstate(all="ignore"):
            numbers = np.random.default_rng(rng.getrandbits(32)).normal(size=shape) * 10.0 ** rng.randrange(-3, 40)
            numbers = numbers if rng.random() < 0.9 else np.full(shape, rng.choice([np.nan, np.inf, 2.0**63]))
            given = numbers.astype(rng.choice(["f4", "f8", "i8", "u1", "c8", "?", ">i8", ">f4", "f2"]))
    return rng.choice(["discrete", "raw", "continuous"]), rng.choice(ACTS), given


def _act(given: tuple[str, str, Any], folder: Path) -> None:
    action_type, act, what = given
    parallel, single, vector, simulator = _envs(action_type)
    with np.errstate(all="ignore"):
        if act == "parallel":
            parallel.reset(seed=1)
            parallel.step({"robot_0": what} if isinstance(what, (int, float, np.ndarray)) else what)
        elif act in ("single", "vector", "step"):
            env = {"single": single, "vector": vector, "step": simulator}[act]
            env.reset(seed=1) if act == "single" else env.reset()
            env.step(what)
        elif act == "put":
            simulator.reset(1)
            simulator.put(what, what if isinstance(what, (int, float)) else np.zeros((2, 2)))
        elif act == "reset_to":
            simulator.reset_to([Assignment(what, what)] * 2 if isinstance(what, np.ndarray) else what)
        elif act == "recorder":
            Recorder(simulator, what)
        else:
            {
                "reset": simulator.reset,
                "reset_world": functools.partial(simulator.reset_world, 0),
                "seed": vector.seed,
            }[act](what)
        assert np.isfinite(simulator.observation).all()


def _make_file(rng: Random) -> tuple[str, bytes]:
    """Return the name of one of READERS, and a good file of it that was damaged, or whose JSON was changed."""
    name = rng.choice(sorted(READERS))
    content = READERS[name].good()
    if READERS[name].text and rng.random() < 0.5:
        with contextlib.suppress(ValueError):
            return name, json_bytes(rng, json.loads(content))
        with contextlib.suppress(ValueError):
            return name, json_lines(rng, [json.loads(line) for line in content.splitlines()])
    return name, damaged(rng, content)


def _file(given: tuple[str, bytes], folder: Path) -> None:
    READERS[given[0]].read(_written(given[1], folder, given[0]))


TARGETS: dict[str, Target] = {
    "file": Target(_make_file, _file, 4000),
    "hall": Target(_make_hall, _hall, 100),
    "episode": Target(lambda rng: making.archive(rng, _members()), _replayed, 120),
    "config": Target(_make_config, _config, 800),
    "plain config": Target(_make_plain, _plain, 500),
    "grid map": Target(lambda rng: options(rng, ["occupied", "height", "cell_size", "picks", "stations", "name",
                                                 "one_way", "origin", "discs", "walls"]), _grid, 500),
    "layout": Target(_make_layout, lambda given, f: make_layout(given[0], **given[1]), 60),
    "planner": Target(_make_planned, _planned, 500),
    "env": Target(lambda rng: (rng.randrange(3), options(rng, OPTIONS)), _env, 60),
    "act": Target(_make_act, _act, 120),
    "live command": Target(lambda rng: json_bytes(rng, rng.choice(LIVE)), lambda given, _: read_command(given), 2000),
}  # fmt: skip


def warm(folder: Path) -> None:
    """Compile what inputs need, which takes longer than any input may."""
    _replayed(an_episode(), folder)
    for action_type in ("discrete", "raw", "continuous"):
        for act in ("single", "vector", "step", "put", "parallel"):
            with contextlib.suppress(ValueError):
                _act((action_type, act, np.zeros((2, 2, 3)) if act == "put" else _good(action_type, act)), folder)


def _good(action_type: str, act: str) -> Any:
    one = 0 if action_type == "discrete" else [0.0, 0.0]
    return {
        "single": one,
        "vector": [one] * 4,
        "step": [[one] * 2] * 2,
        "parallel": dict.fromkeys(("robot_0", "robot_1"), one),
    }[act]
