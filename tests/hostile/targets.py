"""All that reads files or takes values from outside, each with what makes hostile inputs for it."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import inspect
import io
import json
import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

import numpy as np
import torch
from safetensors.numpy import save

from agents import WEIGHTS_FOLDER, Network, PolicyRecord, make_policy, policy_config
from agents.learned import read_policy
from agents.sb3_model import NOTED
from agents.weights_folder import CONFIG, WEIGHTS, read_tensors
from tests.hostile import making
from tests.hostile.making import damaged, json_bytes, json_lines, options, value
from train import cli
from train.clmapf.instance import read_instance
from train.clmapf.solution import read_solution
from train.commands.bench import Bench
from train.commands.demo import Demo
from train.commands.evaluate import Evaluate
from train.commands.kinds import read_fleet
from train.commands.plan import PlanCommand
from train.fleet.build import episode_of
from train.fleet.check import check_log
from train.fleet.driven import load_episode
from train.fleet.factsheet import factsheet_of
from train.fleet.listen import hear_log
from train.learning import checkpoint
from train.learning.config import PPOConfig, ReinforceConfig, ThreadedPPOConfig
from train.learning.curves import read_run
from train.live.commands import read_command
from train.reporting.rows import read_rows, whole_rows
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
from warehouse_env.maps.movingai import EXAMPLE_SCEN, read_map, read_scen, write_map
from warehouse_env.planning import PLANNERS, make_planner
from warehouse_env.routes.plan_store import PlanStore
from warehouse_env.simulation.record.recording import Episode, Recorder
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.tasks.assignment import Assignment
from warehouse_env.simulation.tasks.orders import check_orders, read_orders, write_orders
from warehouse_env.traffic_spec import TrafficSpec, UncertaintySpec
from warehouse_env.work import BatterySpec, OrderSpec, ServiceSpec


class Target(NamedTuple):
    """One reader or constructor."""

    make: Callable[[Random], Any]  # an input
    take: Callable[[Any, Path], Any]  # what is tried with it, in a folder that may be written to
    each: int  # inputs of it in a round, the more the faster it is


SMALL: dict[str, Any] = {"num_agents": 2, "planner": "astar", "layout": "open", "max_steps": 6}
CONFIGS = (
    EnvConfig, RobotSpec, SensorSpec, TrafficSpec, UncertaintySpec, RewardWeights, BatterySpec, OrderSpec, ServiceSpec,
    ReinforceConfig, PPOConfig, ThreadedPPOConfig,
)  # fmt: skip
LIVE: tuple[dict[str, Any], ...] = (
    {"do": "play", "playing": True}, {"do": "speed", "speed": 2.5}, {"do": "leave", "person": 0},
    {"do": "make", "policy": "greedy", "floor": "open", "robots": 8, "seed": 1},
    {"do": "shelves", "cells": [[1, 2], [3, 4]], "stand": True}, {"do": "person", "cell": [5, 6]},
)  # fmt: skip
MAP = b"type octile\nheight 4\nwidth 5\nmap\n.@...\n.....\n..@..\n.....\n"
ORDERS = {
    "o.csv": b"release_s,picks,drop,due_s,weight_kg\n0,1:1 1:4,9:1,600,120\n5,1:7,9:1,600,1\n",
    "o.jsonl": b'{"release_s": 0, "picks": [[1, 1]], "drop": [9, 1], "due_s": 9, "weight_kg": 1.5}\n',
}
FLEETS: tuple[list[Any], ...] = (
    [{"share": 0.25, "robot": {"length": 1.4, "width": 0.8, "wheelbase": 0.9, "front_overhang": 0.25}}],
    [{"share": 0.3, "robot": {"max_speed": 0.8}}, {"share": 0.7, "robot": {}}],
    [{"count": 2, "robot": {"mass": 90.0}}],
)
ONE_WAY = b".....\n.>>>.\n.....\n..v..\n"
CLMAPF = (
    b"agents:\n  - start: [5, 15, 0]\n    name: agent0\n    goal: [22, 15, 1.57]\nmap:\n  dimensions: [30, 40]\n"
    b"  obstacles:\n    - [15.5, 10]\n"
)
CLMAPF_SOLUTION = (
    b"statistics:\n  cost: 9\nschedule:\n  agent0:\n    - x: 5\n      y: 15\n      yaw: 0\n      t: 0\n"
    b"    - x: 6.5\n      y: 15\n      yaw: 0\n      t: 1.5\n"
)
LIF = {"metaInformation": {}, "layouts": [{"layoutId": "a", "nodes": [
    {"nodeId": name, "nodePosition": {"x": x, "y": 1.5}, "vehicleTypeNodeProperties": [{"vehicleTypeId": "v"}]}
    for name, x in (("a", 0.5), ("b", 3.5))], "edges": [{
    "edgeId": "e", "startNodeId": "a", "endNodeId": "b", "vehicleTypeEdgeProperties": [{
        "vehicleTypeId": "v", "rotationAllowed": True, "maxSpeed": 1.0, "trajectory": {
            "degree": 2, "knotVector": [0, 0, 0, 1, 1, 1], "controlPoints": [
                {"x": 0.5, "y": 1.5}, {"x": 2.0, "y": 2.5, "weight": 0.7}, {"x": 3.5, "y": 1.5}]}}]}],
    "stations": [{"stationId": "s", "interactionNodeIds": ["b"], "stationHeight": "0.5"}]}]}  # fmt: skip
GRAPH = {"features": [
    {"properties": {"id": 0}, "geometry": {"type": "Point", "coordinates": [0.5, 1.5]}},
    {"properties": {"id": 1}, "geometry": {"type": "Point", "coordinates": [3.5, 1.5]}},
    {"properties": {"id": 2, "startid": 0, "endid": 1, "metadata": {"speed_limit": 50}},
     "geometry": {"type": "LineString", "coordinates": [[0.5, 1.5], [3.5, 1.5]]}}]}  # fmt: skip
HALL = {
    "h.yaml": b"image: h.pgm\nmode: scale\nresolution: 0.5\norigin: [0.0, -1.5, 0]\nnegate: 0\n"
              b"occupied_thresh: 0.65\nfree_thresh: 0.25\n",
    "h.pgm": b"P5\n8 8\n255\n" + bytes([254] * 40 + [0] * 4 + [205] * 20),
    "k.yaml": b"image: h.pgm\nresolution: 1\norigin: [1, 0.0, 0]\nnegate: 1\noccupied_thresh: .9\nfree_thresh: .3\n",
    "h.png": b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\x04\0\0\0\x04\x08\0\0\0\0",
    "h.discs.json": b'{"discs": [{"x": 1.2, "y": 1.1, "radius": 0.3}]}',
    "h.places.json": b'{"picks": [{"id": 1, "x": 0.5, "y": 1.0}], "stations": [{"x": 2.5, "y": 1.5}]}',
    "h.oneway": b"....\n.>..\n....\n....\n",
    "l.json": json.dumps(LIF).encode(), "l.geojson": json.dumps(GRAPH).encode(),
}  # fmt: skip
SCEN = EXAMPLE_SCEN.read_bytes()[:300]
RECORD = json.loads((WEIGHTS_FOLDER / "threaded_ppo" / CONFIG).read_text())
NETWORK = Network(3, 2, True, (2,))
EVALUATED = [
    {"policy": policy, "layout": "open", "robots": 2, "tasks": "lifelong", "planner": "astar", "episode": seed,
     "seed": seed, "seconds": 9.0, "robot_km": 0.1, "collisions_robot": 0.0, "collisions_shelf": 1.0,
     "collisions_person": 0.0, "collisions_per_km": 1.0, "near_misses": 0.0, "min_clearance_m": None, "goals": 3.0,
     "goals_per_robot_hour": 60.0, "stuck": 0.0, "waiting_share": 0.1, "longest_standing_s": 1.0, "deadlocks": 0.0,
     "longest_deadlock_s": 0.0, "success_rate": 1.0, "path_length_ratio": 1.1, "ms_per_step": 0.2, "config": {}}
    for policy in ("follow", "ppo") for seed in (1, 2)
]  # fmt: skip
PROGRESS = [{"steps": n, "seconds": 1.0, "reward": 0.1, "goals_per_robot_hour": 9.0, "entropy": 1.0} for n in (1, 2)]


def _written(content: bytes, folder: Path, name: str) -> Path:
    path = folder / name
    path.write_bytes(content)
    return path


def _map(given: tuple[bytes, bytes], folder: Path) -> None:
    _written(given[1], folder, "f.oneway")
    grid = read_map(_written(given[0], folder, "f.map"))
    _use(grid)
    write_map(grid, folder / "g.map")


def _make_kinds(rng: Random) -> bytes:
    parts = json.loads(json.dumps(rng.choice(FLEETS)))
    return json_bytes(rng, parts) if rng.random() < 0.7 else damaged(rng, json.dumps(parts).encode())


def _kinds(content: bytes, folder: Path) -> None:
    """Read a fleet's file, and make fleets of what it says."""
    kinds = read_fleet(_written(content, folder, "f.json"))
    assert kinds.words
    EnvConfig(**kinds.each())
    for robots in (1, 2, 64):
        with contextlib.suppress(ValueError):  # more are counted than there are
            fleet = EnvConfig(num_agents=robots, **kinds.of(robots))
            assert len(fleet.robots) == robots
    if kinds.by_share:
        kinds.of(1, 30)


def _make_orders(rng: Random) -> tuple[str, bytes]:
    name = rng.choice(["o.csv", "o.jsonl"])
    return name, damaged(rng, ORDERS[name])


def _orders(given: tuple[str, bytes], folder: Path) -> None:
    name, content = given
    orders = read_orders(_written(content, folder, name))
    write_orders(folder / f"again-{name}", orders)
    check_orders(orders, make_layout("open"), 500.0)


def _make_hall(rng: Random) -> tuple[dict[str, bytes], str]:
    """Return the files of a hall, some of them hostile, and how it is read."""
    files = dict(HALL)
    for name in rng.sample(sorted(files), rng.randint(1, 2)):
        is_json = name.endswith("json")
        files[name] = json_bytes(rng, json.loads(files[name])) if is_json else damaged(rng, files[name])
    how = rng.choice(["", "cell=0.5", "keepout=k.yaml", "speed=k.yaml", "discs=h.discs.json", "lanes=l.json",
                      "lanes=l.geojson", "lanes=l.json,lanes_only=true", "begin=best", "begin=corner",
                      "begin=0.25+0.4", f"begin={rng.choice(making.NUMBERS)}+{rng.random()}", "cell=2,begin=best",
                      "begin=" + making.text(rng), "cell=" + making.text(rng), making.text(rng)])  # fmt: skip
    return files, rng.choice(["h.yaml", "h.yaml", "h.yaml", "h.png"]) + (f":{how}" if how else "")


def _hall(given: tuple[dict[str, bytes], str], folder: Path) -> None:
    for name, content in given[0].items():
        _written(content, folder, name)
    hall = read_hall(f"{folder}/{given[1]}")
    _use(hall.grid)
    list(files_of(f"{folder}/{given[1]}"))
    write_hall(hall.grid, folder / "g.yaml", None, hall.barred)
    write_lif(hall.grid, folder / "g.json")
    write_route_graph(hall.grid, folder / "g.geojson")


def _use(grid: GridMap) -> None:
    """Ask a floor for all that is worked out when it is first asked for."""
    _ = grid.text(), grid.key, grid.legal_moves, repr(grid), len(grid.free_cells), len(grid.endpoints)


@functools.cache
def an_episode() -> bytes:
    """Return the file of a short episode."""
    recorder = Recorder(Simulator(EnvConfig(**SMALL)), (3,))
    for _ in range(2):
        recorder.step(np.zeros((1, 2), int))
    with tempfile.TemporaryDirectory() as folder:
        recorder.episode.save(Path(folder, "e.npz"))
        return Path(folder, "e.npz").read_bytes()


def _fleet_entries() -> list[Any]:
    """Return messages of a vehicle, as they are kept."""
    node = {"nodeId": "n", "sequenceId": 2, "released": True, "nodePosition": {"x": 3.5, "y": 1.5, "mapId": "m"}}
    head = {"headerId": 0, "version": "2.1.0", "manufacturer": "A", "serialNumber": "1"}
    states = [
        {**head, "headerId": k, "timestamp": f"2026-01-01T00:00:0{k}Z", "orderId": "o", "orderUpdateId": 0,
         "lastNodeId": "m", "lastNodeSequenceId": 0, "nodeStates": [node] * (k < 2), "edgeStates": [], "driving": True,
         "agvPosition": {"x": 1.5 + k, "y": 1.5, "theta": 0.1, "mapId": "m", "positionInitialized": True},
         "actionStates": [], "batteryState": {"batteryCharge": 9, "charging": False}, "operatingMode": "AUTOMATIC",
         "errors": [{"errorType": "contactRobot", "errorLevel": "WARNING"}], "loads": [{"loadId": "l"}],
         "safetyState": {"eStop": "NONE", "fieldViolation": False}}
        for k in range(3)
    ]  # fmt: skip
    ordered = {**node, "actions": []}
    order = {
        **head,
        "timestamp": "2026-01-01T00:00:00Z",
        "orderId": "o",
        "orderUpdateId": 0,
        "nodes": [{**ordered, "nodeId": "m", "sequenceId": 0}, ordered],
        "edges": [
            {"edgeId": "e", "sequenceId": 1, "released": True, "startNodeId": "m", "endNodeId": "n", "actions": []}
        ],
    }
    topics = [("order", order), *(("state", state) for state in states)]
    logged = [{"topic": f"uagv/v2/A/1/{name}", "qos": 0, "retain": 0, "payload": one} for name, one in topics]
    sheet = {"topic": "uagv/v2/A/1/factsheet", "payload": factsheet_of(EnvConfig(), 1.0)}
    return [sheet, *logged, {**states[0], "serialNumber": "2"}, {**states[2], "serialNumber": "2"}]


def _make_fleet_log(rng: Random) -> bytes:
    return json_lines(rng, _fleet_entries())


def _fleet_log(content: bytes, folder: Path) -> None:
    path = _written(content, folder, "log.jsonl")
    with contextlib.suppress(ValueError):
        check_log(path)
    made = episode_of(hear_log(path).fleet, make_layout("open"), EnvConfig(layout="open"))
    made.row()
    made.save(folder / "e.npz")
    load_episode(folder / "e.npz")


@functools.cache
def _members() -> dict[str, bytes]:
    with zipfile.ZipFile(io.BytesIO(an_episode())) as file:
        return {name: file.read(name) for name in file.namelist()}


def _replayed(content: bytes, folder: Path) -> None:
    for _ in Episode.load(_written(content, folder, "e.npz")).replay():
        pass


def _rows(content: bytes, folder: Path) -> None:
    path = _written(content, folder, "rows.jsonl")
    whole_rows(path)
    read_rows(path)


def _run(given: tuple[bytes, bytes], folder: Path) -> None:
    _written(given[0], folder, CONFIG)
    _written(given[1], folder, "progress.jsonl")
    read_run(folder).rows()


def _policy(content: bytes, folder: Path) -> None:
    _written((WEIGHTS_FOLDER / "threaded_ppo" / WEIGHTS).read_bytes(), folder, WEIGHTS)
    _written(content, folder, CONFIG)
    make_policy(folder, policy_config(folder, EnvConfig(**SMALL)))


@functools.cache
def _model() -> tuple[bytes, bytes]:
    """What a model's file of stable-baselines3 has in it that is read."""
    sizes = {"mlp_extractor.policy_net.0": (2, 92), "mlp_extractor.value_net.0": (2, 92)}
    sizes |= {"action_net": (20, 2), "value_net": (1, 2)}
    state = {f"{name}.weight": torch.ones(size) for name, size in sizes.items()}
    torch.save(state | {f"{name}.bias": torch.ones(size[0]) for name, size in sizes.items()}, pth := io.BytesIO())
    return json.dumps({"policy_kwargs": {}, "clip_range": 0.2, "use_sde": False}).encode(), pth.getvalue()


def _make_model(rng: Random) -> bytes:
    data, pth = _model()
    about = {**json.loads(data), NOTED: EnvConfig().to_dict()}
    data, pth = rng.choice([(json_bytes(rng, about), pth), (data, damaged(rng, pth)), (data, pth)])
    with zipfile.ZipFile(file := io.BytesIO(), "w") as archive:
        archive.writestr("data", data)
        archive.writestr("policy.pth", pth)
    return rng.choice([file.getvalue(), damaged(rng, file.getvalue())])


def _weights() -> bytes:
    return save({name: np.ones(shape, np.float32) for name, shape in NETWORK.shapes().items()})


@functools.cache
def _state() -> dict[str, bytes]:
    with tempfile.TemporaryDirectory() as folder:
        checkpoint.write(Path(folder), {"x": np.zeros(3)}, {"update": 1})
        return {path.name: path.read_bytes() for path in Path(folder).iterdir()}


def _make_checkpoint(rng: Random) -> dict[str, bytes]:
    files = dict(_state())
    name = rng.choice(sorted(files))
    files[name] = json_bytes(rng, json.loads(files[name])) if name.endswith(".json") else damaged(rng, files[name])
    return files


def _checkpoint(files: dict[str, bytes], folder: Path) -> None:
    for name, content in files.items():
        _written(content, folder, name)
    checkpoint.read(folder)


@functools.cache
def _plans() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        store = PlanStore(Path(folder))
        for k in range(40):
            store.put(f"key {k}", np.arange(2 * (k % 7 + 1)).reshape(-1, 2))
        store.flush()
        return next(Path(folder).glob("*.sqlite")).read_bytes()


def _store(content: bytes, folder: Path) -> None:
    _written(content, folder, "plans-3.sqlite")
    store = PlanStore(folder)
    for k in range(10):
        cells = store.get(f"key {k}")
        assert cells is None or (cells.ndim, cells.shape[1], cells.dtype) == (2, 2, np.int64)
        store.put(f"new {k}", np.zeros((2, 2), np.int64))
    store.flush()


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


@functools.cache
def _words() -> dict[str, list[str]]:
    """Return the options of all commands."""
    return {name: sorted(_names(cli._options_of(name))) for name in cli.COMMANDS}


def _names(kind: Any) -> set[str]:
    return {f"--{field.name.replace('_', '-')}" for field in dataclasses.fields(kind)}


def _make_line(rng: Random) -> tuple[str, list[str]]:
    name = rng.choice(sorted(cli.COMMANDS))
    odd = ["--", "-", "", "--help", "--seed", "-1", "1e999", "None", "True", "@x", "=", "--x=1", "99999999999999999999"]
    words = [
        rng.choice([rng.choice(_words()[name]), rng.choice(odd), making.text(rng), str(rng.randrange(-5, 50))])
        for _ in range(rng.randrange(6))
    ]
    return name, words


def _line(given: tuple[str, list[str]], folder: Path) -> None:
    name, words = given
    aside, options = io.StringIO(), cli._options_of(name)
    with contextlib.redirect_stdout(aside), contextlib.redirect_stderr(aside), contextlib.suppress(SystemExit):
        cli._options(options, name, words)


TARGETS: dict[str, Target] = {
    "map": Target(lambda rng: (damaged(rng, MAP), rng.choice([ONE_WAY, damaged(rng, ONE_WAY)])), _map, 500),
    "hall": Target(_make_hall, _hall, 100),
    "scen": Target(lambda rng: damaged(rng, SCEN), lambda given, f: read_scen(_written(given, f, "s")), 1000),
    "clmapf instance": Target(lambda rng: damaged(rng, CLMAPF),
                              lambda given, f: read_instance(_written(given, f, "i"), "i"), 1000),
    "clmapf solution": Target(lambda rng: damaged(rng, CLMAPF_SOLUTION),
                              lambda given, f: read_solution(_written(given, f, "s")), 1000),
    "episode": Target(lambda rng: making.archive(rng, _members()), _replayed, 120),
    "episode bytes": Target(lambda rng: damaged(rng, an_episode()), _replayed, 200),
    "rows": Target(lambda rng: json_lines(rng, EVALUATED), _rows, 200),
    "run": Target(lambda rng: (json_bytes(rng, RECORD) if rng.random() < 0.3 else json.dumps(RECORD).encode(),
                               json_lines(rng, PROGRESS)), _run, 100),
    "policy": Target(lambda rng: json_bytes(rng, RECORD), _policy, 60),
    "weights": Target(lambda rng: damaged(rng, _weights()),
                      lambda given, f: read_tensors(_written(given, f, WEIGHTS).parent, NETWORK), 1000),
    "model": Target(_make_model, lambda given, f: read_policy(_written(given, f, "model.zip")), 100),
    "checkpoint": Target(_make_checkpoint, _checkpoint, 400),
    "plan store": Target(lambda rng: damaged(rng, _plans()), _store, 20),
    "orders": Target(_make_orders, _orders, 1000),
    "fleet kinds": Target(_make_kinds, _kinds, 500),
    "config": Target(_make_config, _config, 800),
    "plain config": Target(_make_plain, _plain, 500),
    "grid map": Target(lambda rng: options(rng, ["occupied", "height", "cell_size", "picks", "stations", "name",
                                                 "one_way", "origin", "discs", "walls"]), _grid, 500),
    "layout": Target(_make_layout, lambda given, f: make_layout(given[0], **given[1]), 60),
    "planner": Target(_make_planned, _planned, 500),
    "env": Target(lambda rng: (rng.randrange(3), options(rng, OPTIONS)), _env, 60),
    "act": Target(_make_act, _act, 120),
    "command line": Target(_make_line, _line, 6),
    "fleet log": Target(_make_fleet_log, _fleet_log, 60),
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
