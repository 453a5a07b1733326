"""List the readers of users' files, each with the content of a small valid file."""

from __future__ import annotations

import functools
import json
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from safetensors.numpy import save

from agents import WEIGHTS_FOLDER, Network
from agents.weights_folder import CONFIG, read_record, read_tensors
from train.clmapf.instance import read_instance, read_solution
from train.commands.compare import read_runs
from train.execute.delays import read_delays
from train.execute.read import read_plan
from train.fleet.check import check_log
from train.fleet.driven import load_episode
from train.fleet.messages import factsheet_of
from train.fleet.received import hear_log
from train.kinds import read_fleet
from train.learning import checkpoint
from train.reporting.rows import read_rows, whole_rows
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError, MapError, PlanError, WarehouseError, WeightsError
from warehouse_env.files import file_digest
from warehouse_env.maps.discs import read_discs
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.halls.lif import read_lif
from warehouse_env.maps.halls.map_server import read_occupancy, read_picture
from warehouse_env.maps.halls.places import read_places
from warehouse_env.maps.halls.route_graph import read_route_graph
from warehouse_env.maps.movingai import read_map, read_scen
from warehouse_env.simulation.record.recording import Episode, Recorder
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.tasks.orders import read_orders

SMALL: dict[str, Any] = {"num_agents": 2, "planner": "astar", "layout": "open", "max_steps": 6}
MAP = b"type octile\nheight 4\nwidth 5\nmap\n.@...\n.....\n..@..\n.....\n"
ORDERS = b"release_s,picks,drop,due_s,weight_kg\n0,1:1 1:4,9:1,600,120\n5,1:7,9:1,600,1\n"
FLEET = [{"share": 0.25, "robot": {"length": 1.4, "width": 0.8, "wheelbase": 0.9, "front_overhang": 0.25}}]
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
RECORD = json.loads((WEIGHTS_FOLDER / "shielded" / CONFIG).read_text())
NETWORK = Network(3, 2, True, (2,))
EVALUATED: list[dict[str, Any]] = [
    {"policy": policy, "layout": "open", "robots": 2, "tasks": "lifelong", "planner": "astar", "episode": seed,
     "seed": seed, "seconds": 9.0, "robot_km": 0.1, "collisions_robot": 0.0, "collisions_shelf": 1.0,
     "collisions_person": 0.0, "collisions_per_km": 1.0, "near_misses": 0.0, "min_clearance_m": None, "goals": 3.0,
     "goals_per_robot_hour": 60.0, "stuck": 0.0, "waiting_share": 0.1, "longest_standing_s": 1.0, "deadlocks": 0.0,
     "longest_deadlock_s": 0.0, "success_rate": 1.0, "path_length_ratio": 1.1, "ms_per_step": 0.2, "config": {}}
    for policy in ("follow", "ppo") for seed in (1, 2)
]  # fmt: skip


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
    """Return stored messages of a vehicle."""
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


def _weights() -> bytes:
    return save({name: np.ones(shape, np.float32) for name, shape in NETWORK.shapes().items()})


@functools.cache
def _state() -> dict[str, bytes]:
    with tempfile.TemporaryDirectory() as folder:
        checkpoint.write(Path(folder), {"x": np.zeros(3)}, {"update": 1})
        return {path.name: path.read_bytes() for path in Path(folder).iterdir()}


class Reader(NamedTuple):
    """The function that reads a file, the content of a small valid one, and the error class."""

    read: Callable[[Path], Any]
    good: Callable[[], bytes]
    error: type[WarehouseError] = MapError
    text: bool = False  # other programs may save it with other line ends or a byte order mark


def of_text(read: Callable[[Path], Any], good: bytes, error: type[WarehouseError] = MapError) -> Reader:
    return Reader(read, lambda: good, error, text=True)


def rows(listed: list[dict[str, Any]]) -> bytes:
    return "\n".join(map(json.dumps, listed)).encode() + b"\n"


def with_one_way(path: Path) -> Any:
    path.with_suffix(".map").write_bytes(MAP.replace(b"@", b"."))
    return read_map(path.with_suffix(".map")).one_way.tolist()


def with_picture(path: Path) -> Any:
    path.with_name("h.pgm").write_bytes(HALL["h.pgm"])
    return read_occupancy(path).values.tolist()


def with_other_rows(path: Path) -> Any:
    path.with_name("other.jsonl").write_bytes(rows(EVALUATED))
    return [*read_runs([path.with_name("other.jsonl"), path]).values()][1]


def of_checkpoint(path: Path) -> Any:
    for name, content in _state().items():
        if name != path.name:
            path.with_name(name).write_bytes(content)
    return checkpoint.read(path.parent)


def of_plan(path: Path) -> Any:
    scen = path.with_suffix(".scen")
    scen.write_text("version 1\n0\tm\t6\t6\t1\t1\t2\t1\t1\n0\tm\t6\t6\t3\t3\t3\t2\t1\n")
    plan = read_plan(path, GridMap(np.zeros((6, 6), bool)), scen if path.suffix == ".csv" else None)
    return plan.cells.tolist(), plan.tasks, plan.ticks


LOG = rows(_fleet_entries())
LEAGUE_PLAN = {
    "start": [[1, 1, "E"], [3, 3, "N"]], "agentMaxCounter": 2, "events": [[2, 0, 7, 1]],
    "actualPaths": ["[(0,1,1,0,0):(F 2,W 1)]", "[(0,3,3,3,0):(W 1,F 2)]"],
}  # fmt: skip
LEAGUE_PROBLEM = {"agentCounter": 3, "delayConfig": {"pDelay": 0.1, "minDelay": 2, "maxDelay": 4}}
READERS: dict[str, Reader] = {
    "m.map": of_text(lambda path: read_map(path).key, MAP),
    "m.oneway": of_text(with_one_way, ONE_WAY),
    "m.scen": of_text(read_scen, b"version 1\n3\tm.map\t5\t4\t1\t0\t3\t2\t4.5\n"),
    "d.json": of_text(lambda path: read_discs(path).tolist(), HALL["h.discs.json"]),
    "h.places.json": of_text(read_places, HALL["h.places.json"]),
    "l.json": of_text(lambda path: sorted(read_lif(path).nodes), HALL["l.json"]),
    "l.geojson": of_text(lambda path: sorted(read_route_graph(path).nodes), HALL["l.geojson"]),
    "h.yaml": of_text(with_picture, HALL["h.yaml"]),
    "h.pgm": Reader(read_picture, lambda: HALL["h.pgm"]),
    "h.png": Reader(read_picture, lambda: HALL["h.png"]),
    "o.csv": of_text(read_orders, ORDERS, ConfigError),
    "fleet.json": of_text(read_fleet, json.dumps(FLEET).encode(), ConfigError),
    "e.npz": Reader(Episode.load, an_episode, WarehouseError),
    "driven.npz": Reader(load_episode, an_episode, WarehouseError),
    "config.json": of_text(lambda path: read_record(path.parent), json.dumps(RECORD).encode(), WeightsError),
    "weights.safetensors": Reader(
        lambda path: read_tensors(path.parent, NETWORK), _weights, WeightsError
    ),
    "state.json": of_text(of_checkpoint, _state()["state.json"], WeightsError),
    "arrays-1.safetensors": Reader(of_checkpoint, lambda: _state()["arrays-1.safetensors"], WeightsError),
    "rows.jsonl": of_text(read_rows, rows([{"a": "é"}, {"a": 2}]), WarehouseError),
    "whole.jsonl": Reader(whole_rows, lambda: rows([{"a": 1}]), WarehouseError),
    "run.jsonl": of_text(with_other_rows, rows(EVALUATED), WarehouseError),
    "instance.yaml": of_text(lambda path: repr(read_instance(path, "i")), CLMAPF),
    "solution.yaml": of_text(lambda path: repr(read_solution(path)), CLMAPF_SOLUTION),
    "plan.txt": of_text(of_plan, b"0:(1,1),(3,3),\n1:(2,1),(3,3),\n", PlanError),
    "plan.json": of_text(of_plan, json.dumps(LEAGUE_PLAN).encode(), PlanError),
    "plan.csv": of_text(of_plan, b'agents,solution_plan\n2,"rw\nwd"\n', PlanError),
    "problem.json": of_text(lambda path: read_delays(path, 0.6), json.dumps(LEAGUE_PROBLEM).encode(), ConfigError),
    "log.jsonl": of_text(lambda path: check_log(path).messages, LOG, WarehouseError),
    "heard.jsonl": of_text(lambda path: hear_log(path).messages, LOG, WarehouseError),
    "digest": Reader(file_digest, lambda: b"any", WarehouseError),
}  # fmt: skip
