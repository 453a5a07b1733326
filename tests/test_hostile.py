"""Feed hostile inputs to all readers and constructors: each works or raises one sentence.

make hostile      # HOSTILE=1000 times as many inputs as `make test`, new ones each time
"""

from __future__ import annotations

import contextlib
import dataclasses
import faulthandler
import functools
import inspect
import io
import json
import os
import re
import resource
import tempfile
import warnings
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from agents import Network, PolicyRecord, make_policy
from tests.readers import EVALUATED, HALL, NETWORK, READERS, SMALL, an_episode
from train.commands.bench import Bench
from train.commands.compare import compare, read_runs
from train.commands.demo import Demo
from train.commands.evaluate import Evaluate
from train.commands.plan import PlanCommand
from train.evaluation.episodes import EpisodesJob
from train.evaluation.rollout import make_experiment
from train.learning.config import PPOConfig, ReinforceConfig, ThreadedPPOConfig
from train.learning.progress import ProgressLog
from train.live.world import read_command
from train.reporting.rows import read_rows
from train.tables.runner import PlanBlock
from warehouse_env.checked import from_plain, parse_named
from warehouse_env.config import EnvConfig, RewardWeights, RobotSpec, SensorSpec
from warehouse_env.envs.parallel import parallel_env, single_env
from warehouse_env.envs.vector import vec_env
from warehouse_env.errors import MapWarning, WarehouseError
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.halls.hall import files_of, read_hall
from warehouse_env.maps.halls.lif import write_lif
from warehouse_env.maps.halls.route_graph import write_route_graph
from warehouse_env.maps.halls.saved import write_hall
from warehouse_env.maps.layouts import LAYOUTS, make_layout
from warehouse_env.maps.movingai import read_map
from warehouse_env.planning import PLANNERS, make_planner
from warehouse_env.simulation.record.recording import Episode, Recorder
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.tasks.assignment import Assignment
from warehouse_env.traffic_spec import TrafficSpec, UncertaintySpec
from warehouse_env.work import BatterySpec, OrderSpec, ServiceSpec

TIMES = int(os.environ.get("HOSTILE", "1"))
LONGEST = 300  # [s] per input, which may first compile a kernel
LARGEST = 2e9  # [bytes] of address space beyond the initial use

NUMBERS: list[Any] = [
    0, 1, 2, -1, 3, 7, 40, 0.5, -0.0, 1e-320, 10**9, 10**12, 2**31, 2**63, 2**64, -(2**70), 10**400, 1e30, -1e300, True,
    float("nan"), float("inf"), -float("inf"), np.float32(0.5), np.float64(np.nan), np.int8(3), np.uint64(2**64 - 1),
    np.bool_(True), np.float16(1e4), np.longdouble(1),
]  # fmt: skip
OTHERS: list[Any] = [
    None, "", "x", "\0", "\ud800", "\u202e", "a" * 5000, "../..", "/", "/dev/null", "~", "a/b", ".", "é\n", b"a",
    object(), {}, {"a": 1}, {1: 2}, [], (), set(), 1j, np.zeros(2), np.zeros((2, 2)), np.array(1.0), np.array(["a"]),
    [[0, 1], [1]], [(0, 0)], [[2**70, 0]], Path("p"), EnvConfig, EnvConfig(), SensorSpec(), "lifelong", "raw", range(3),
    np.zeros((0, 2), int), np.array([[0, 2**64 - 1]], np.uint64), np.array([object()]), np.datetime64("2020"),
    np.full((4, 2), 1e300), np.full((2, 2), 2**63, np.uint64), [1, [2]], [0, 1], lambda: 3, GridMap(np.zeros((3, 3))),
    bytearray(b"x"), memoryview(b"xy"), "open", "astar", "paper46:seed=1", "open:rows=99999999",
]  # fmt: skip
PIECES = [
    b"", b"9999999", b"-1", b"\xff\xfe", b"\xef\xbb\xbf", b"null", b"NaN", b"1e999", b"[" * 3000, b'{"a":' * 2000,
    b"1" * 5000, b"\0", b"\r\n", b"\n", b"\t", b'"', b"\\ud800", "\u0663".encode(), b"0x10", b"1_000", b" ", b"@", b"v",
]  # fmt: skip
PLAIN: list[Any] = [
    None, True, 0, -1, 2.5, 1e30, 10**30, float("inf"), float("nan"), "", "x", "\0", "\ud800", "raw", [], {}, [[1]],
    {"a": None}, ["x"] * 40, "../x", "é" * 300, -1e-320, 1 << 63,
]  # fmt: skip
ANY = st.sampled_from(NUMBERS) | st.sampled_from(OTHERS) | st.integers(-5, 50) | st.floats() | st.text(max_size=8)
VALUES = ANY | st.lists(ANY, max_size=3) | st.lists(ANY, max_size=3).map(tuple)
CONFIGS: tuple[Any, ...] = (
    EnvConfig, RobotSpec, SensorSpec, TrafficSpec, UncertaintySpec, RewardWeights, BatterySpec, OrderSpec, ServiceSpec,
    ReinforceConfig, PPOConfig, ThreadedPPOConfig,
)  # fmt: skip
LIVE: tuple[dict[str, Any], ...] = (
    {"do": "play", "playing": True}, {"do": "speed", "speed": 2.5},
    {"do": "make", "policy": "greedy", "floor": "open", "robots": 8, "seed": 1},
)  # fmt: skip


def options(names: list[str]) -> st.SearchStrategy[dict[str, Any]]:
    """Draw arbitrary values for some of the names."""
    return st.dictionaries(st.sampled_from(names), VALUES, min_size=1, max_size=3)


def fields(kind: Any) -> list[str]:
    return [field.name for field in dataclasses.fields(kind)]


@st.composite
def damaged(draw: st.DrawFn, content: bytes) -> bytes:
    """Draw bytes with parts removed, inserted or doubled, or with a changed number."""
    for _ in range(draw(st.integers(1, 4))):
        numbers = list(re.finditer(rb"\d+", content[:100_000]))
        if numbers and draw(st.booleans()):
            begin, end = draw(st.sampled_from(numbers)).span()
            put = draw(st.sampled_from([b"0", b"-1", b"7", b"4294967296", b"9" * 30, b"1e400", b"nan", b"65536"]))
        else:
            begin = draw(st.integers(0, len(content)))
            end = min(len(content), begin + draw(st.sampled_from([0, 1, 2, 8, 64, len(content)])))
            put = draw(st.sampled_from(PIECES) | st.binary(max_size=3) | st.just(2 * content[begin:end][: 10**6]))
        content = content[:begin] + put + content[end:]
    return content


@st.composite
def changed(draw: st.DrawFn, data: Any) -> Any:
    """Draw JSON data with an entry at any depth removed, renamed or changed."""
    keys = list(data) if isinstance(data, dict) else list(range(len(data))) if isinstance(data, list) else []
    if not keys:
        return draw(st.sampled_from(PLAIN) | st.integers(0, 1000))
    key, copy, kind = draw(st.sampled_from(keys)), data.copy(), draw(st.integers(0, 9))
    if kind == 0:
        del copy[key]
    elif kind == 1 and isinstance(data, dict):
        copy[draw(st.text(max_size=8))] = copy.pop(key)
    else:
        copy[key] = draw(changed(data[key] if kind < 8 else None))
    return copy


def json_bytes(data: Any) -> st.SearchStrategy[bytes]:
    """Draw changed JSON data or damaged JSON text."""
    return changed(data).map(lambda other: json.dumps(other).encode()) | damaged(json.dumps(data).encode())


@pytest.fixture(scope="module", autouse=True)
def _limited() -> Iterator[None]:
    """Limit memory to LARGEST beyond the initial use."""
    limits = resource.getrlimit(resource.RLIMIT_AS)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (int(used + LARGEST), limits[1]))
    yield
    resource.setrlimit(resource.RLIMIT_AS, limits)


def inputs(count: int) -> Callable[[Any], Any]:
    """Return settings that try `count` inputs, times TIMES."""
    return settings(max_examples=count * TIMES, derandomize=TIMES == 1, suppress_health_check=list(HealthCheck))


def works_or_raises_one_sentence(make: Callable[[], Any]) -> None:
    """Check that `make` works or raises a WarehouseError of one sentence within LONGEST."""
    message = "it works"
    faulthandler.dump_traceback_later(LONGEST, exit=True)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", MapWarning)  # names places that a large footprint cannot reach
        try:
            make()
        except WarehouseError as error:
            message = str(error)
        finally:
            faulthandler.cancel_dump_traceback_later()
    assert 0 < len(message) < 700
    assert "\n" not in message


@contextlib.contextmanager
def written(files: dict[str, bytes]) -> Iterator[Path]:
    """Yield a folder in memory that holds these files."""
    with tempfile.TemporaryDirectory(dir="/dev/shm" if os.access("/dev/shm", os.W_OK) else None) as folder:
        for name, content in files.items():
            Path(folder, name).write_bytes(content)
        yield Path(folder)


@pytest.mark.parametrize("name", sorted(READERS))
@inputs(15)
@given(st.data())
def test_damaged_files_work_or_raise_one_sentence(name: str, data: st.DataObject) -> None:
    content = READERS[name].good()
    ways = [damaged(content)]
    with contextlib.suppress(ValueError):
        ways.append(json_bytes(json.loads(content)))
    with contextlib.suppress(ValueError):
        rows = [json.loads(line) for line in content.splitlines()]
        ways.append(st.tuples(*(st.just(row) | changed(row) for row in rows)).map(
            lambda some: "\n".join(map(json.dumps, some)).encode()
        ))  # fmt: skip
    with written({name: data.draw(st.one_of(ways))}) as folder:
        works_or_raises_one_sentence(lambda: READERS[name].read(folder / name))


HOW = ("", "cell=0.5", "keepout=k.yaml", "speed=k.yaml", "lanes=l.json", "lanes=l.geojson",
       "lanes=l.json,lanes_only=true", "cell=2")  # fmt: skip


@inputs(15)
@given(
    st.sampled_from(sorted(HALL)).flatmap(lambda name: st.tuples(st.just(name), damaged(HALL[name]))),
    st.sampled_from(HOW) | st.text(max_size=8) | st.sampled_from(NUMBERS).map("cell={}".format),
)
def test_damaged_halls_work_or_raise_one_sentence(file: tuple[str, bytes], how: str) -> None:
    with written({**HALL, file[0]: file[1]}) as folder:
        works_or_raises_one_sentence(lambda: _hall(folder, f"{folder}/h.yaml" + (f":{how}" if how else "")))


def _hall(folder: Path, name: str) -> None:
    hall = read_hall(name)
    _use(hall.grid)
    list(files_of(name))
    write_hall(hall.grid, folder / "g.yaml")
    write_lif(hall.grid, folder / "g.json")
    write_route_graph(hall.grid, folder / "g.geojson")


def _use(grid: GridMap) -> None:
    """Compute all lazy properties of a floor."""
    _ = grid.text(), grid.key, grid.legal_moves, repr(grid), len(grid.free_cells), len(grid.endpoints)


@inputs(15)
@given(st.data())
def test_damaged_episodes(data: st.DataObject) -> None:
    with zipfile.ZipFile(io.BytesIO(an_episode())) as file:
        members = {name: file.read(name) for name in file.namelist()}
    name = data.draw(st.sampled_from(sorted(members)))
    other = data.draw(damaged(members[name]) | st.sampled_from([None, *members.values()]))
    with zipfile.ZipFile(content := io.BytesIO(), "w") as archive:
        for one, held in (members | {name: other}).items():
            if held is not None:
                archive.writestr(zipfile.ZipInfo(one), held)
    with written({"e.npz": content.getvalue()}) as folder:
        works_or_raises_one_sentence(lambda: list(Episode.load(folder / "e.npz").replay()))


NEEDED: dict[Any, dict[str, Any]] = {
    Network: {"observation_size": 3, "actions": 2, "discrete": True},
    PolicyRecord: {"algorithm": "a", "network": NETWORK, "env": EnvConfig()},
}


@pytest.mark.parametrize("kind", [*CONFIGS, Network, PolicyRecord, Bench, Demo, Evaluate, PlanCommand])
@inputs(8)
@given(st.data())
def test_configurations(kind: Any, data: st.DataObject) -> None:
    parts = data.draw(options([*fields(kind), "zz"]))
    works_or_raises_one_sentence(lambda: repr(from_plain(kind, {**NEEDED.get(kind, {}), **parts})))


def _plain(made: Any) -> Any:
    return made.to_dict() if hasattr(made, "to_dict") else dataclasses.asdict(made)


@pytest.mark.parametrize("kind", CONFIGS)
@inputs(8)
@given(st.data())
def test_stored_configurations(kind: Any, data: st.DataObject) -> None:
    content, stored = data.draw(json_bytes(_plain(kind()))), None
    with contextlib.suppress(ValueError, RecursionError):
        stored = json.loads(content)

    def take() -> None:
        made = from_plain(kind, stored)
        assert from_plain(kind, json.loads(json.dumps(_plain(made), allow_nan=False))) == made

    works_or_raises_one_sentence(take)


MAP = ["occupied", "height", "cell_size", "picks", "stations", "name", "one_way", "origin", "discs", "walls"]


@inputs(50)
@given(options(MAP))
def test_grid_maps(parts: dict[str, Any]) -> None:
    works_or_raises_one_sentence(lambda: _use(GridMap(**{"occupied": np.zeros((4, 5)), **parts})))


@inputs(10)
@given(st.data())
def test_layouts(data: st.DataObject) -> None:
    name = data.draw(st.sampled_from(sorted(LAYOUTS)))
    names = [*inspect.signature(LAYOUTS[name]).parameters, "zz"]
    sized = data.draw(st.dictionaries(st.sampled_from(names), st.integers(0, 60) | VALUES, max_size=2))
    key, value = data.draw(st.sampled_from(names)), data.draw(st.text(max_size=8) | st.integers(0, 50))
    asked = data.draw(st.sampled_from([name, f"{name}:{key}={value}"]) | VALUES)
    works_or_raises_one_sentence(lambda: make_layout(asked, **sized))


CELLS = VALUES | st.tuples(st.integers(0, 6), st.integers(0, 6))


@inputs(50)
@given(st.data())
def test_planners(data: st.DataObject) -> None:
    known = data.draw(st.sampled_from(sorted(PLANNERS)))
    given = data.draw(st.just({}) | options([*inspect.signature(PLANNERS[known]).parameters, "zz"]))
    name = data.draw(st.sampled_from([known, f"{known}:{data.draw(st.text(max_size=8))}"]) | VALUES)
    works_or_raises_one_sentence(lambda: make_planner(name, **given))
    start, goal, grid = data.draw(CELLS), data.draw(CELLS), GridMap(np.zeros((4, 5)))
    works_or_raises_one_sentence(lambda: grid.distance_to(start))
    works_or_raises_one_sentence(lambda: make_planner("astar").plan(grid, start, goal, np.random.default_rng(0)))


@pytest.mark.parametrize("make", [parallel_env, single_env, functools.partial(vec_env, num_worlds=1)])
@inputs(5)
@given(options([*fields(EnvConfig), "grid", "config", "render_mode", "num_worlds", "zz"]))
def test_environments(make: Any, given: dict[str, Any]) -> None:
    works_or_raises_one_sentence(lambda: make(**{**SMALL, **given}))


@functools.cache
def _envs(action_type: Any) -> tuple[Any, ...]:
    config = EnvConfig(action_type=action_type, **SMALL)
    return parallel_env(config), single_env(config), vec_env(2, config), Simulator(config, 2)


@st.composite
def arrays(draw: st.DrawFn) -> Any:
    shape = tuple(draw(st.lists(st.sampled_from([0, 1, 2, 3, 20]), min_size=1, max_size=4)))
    with np.errstate(all="ignore"):
        drawn = np.random.default_rng(draw(st.integers(0, 99))).normal(size=shape) * 10.0 ** draw(st.integers(-3, 40))
        drawn = draw(st.sampled_from([drawn] * 8 + [np.full(shape, odd) for odd in (np.nan, np.inf, 2.0**63)]))
        return drawn.astype(draw(st.sampled_from(["f4", "f8", "i8", "u1", "c8", "?", ">i8", ">f4", "f2"])))


ACTS = (
    "parallel", "single", "vector", "step", "put", "reset", "reset_world", "seed", "assignments", "recorder", "options",
)  # fmt: skip


@pytest.mark.parametrize("act", ACTS)
@pytest.mark.parametrize("action_type", ["discrete", "raw", "continuous"])
@inputs(5)
@given(VALUES | arrays())
def test_actions_seeds_and_poses(action_type: str, act: str, what: Any) -> None:
    parallel, single, vector, simulator = _envs(action_type)

    def take() -> None:
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
        elif act == "assignments":
            simulator.reset(None, [Assignment(what, what)] * 2 if isinstance(what, np.ndarray) else what)
        elif act == "recorder":
            Recorder(simulator, what)
        elif act == "options":
            parallel.reset(options=what if isinstance(what, dict) else {"starts": what, "goals": what})
            vector.set_options(what)
            vector.reset()
        else:
            {"reset": simulator.reset, "reset_world": functools.partial(simulator.reset_world, 0), "seed": vector.seed}[
                act
            ](what)
        assert np.isfinite(simulator.observation).all()

    with np.errstate(all="ignore"):
        works_or_raises_one_sentence(take)


@inputs(200)
@given(st.sampled_from(LIVE).flatmap(json_bytes))
def test_messages_of_live_pages(message: bytes) -> None:
    works_or_raises_one_sentence(lambda: read_command(message))


def _simulator() -> Simulator:
    simulator = Simulator(EnvConfig(**SMALL))
    simulator.reset(1)
    return simulator


def test_actions_of_other_byte_order_are_equal() -> None:
    ours, theirs = _simulator(), _simulator()
    actions = np.array([[3, 16]])
    assert np.array_equal(ours.step(actions), theirs.step(actions.astype(">i8")))


@pytest.mark.parametrize(
    ("field", "value"), [("layout", []), ("robots", "x"), ("seed", None), ("stuck", "a"), ("stuck", 1e300)]
)
def test_rows_with_wrong_values_are_not_compared(tmp_path: Path, field: str, value: object) -> None:
    for name, rows in (("a", EVALUATED), ("b", [{**EVALUATED[0], field: value}, *EVALUATED[1:]])):
        (tmp_path / f"{name}.jsonl").write_text("\n".join(map(json.dumps, rows)))
    with pytest.raises(WarehouseError, match=f"a {field} is none"):
        compare(read_runs([tmp_path / "a.jsonl", tmp_path / "b.jsonl"]))


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: parse_named(f"{'x' * 5000}:a", "layout", "b"), r"layout x{70,80}.* must be PARAMETER=VALUE"),
        (lambda: _simulator().reset(None, 3), "assignments must be 1 of type Assignment"),  # type: ignore[arg-type]
        (lambda: make_policy("~nobody-of-this-name", EnvConfig()), "unknown policy"),
        (lambda: make_policy("~\0", EnvConfig()), "unknown policy"),
        (lambda: make_policy("~\ud800", EnvConfig()), "unknown policy"),
        (lambda: GridMap(np.zeros((2, 2)), name="a" * 5000).check_cell((9, 9), "goal"), r"outside map 'a{70,80}"),
        (lambda: GridMap(np.zeros((2, 2))).check_cell((10**400, 0), "goal"), r"goal \(10{70,80}"),
        (lambda: read_map("a\nb.map"), "is no file name"),
        (lambda: Episode.load("a" * 300), "is no file name"),
        (lambda: Episode.load("a/" * 3000), "is no file name"),
        (lambda: Recorder(_simulator(), (2**70,)), r"below 2\*\*63"),
    ],
)
def test_invalid_arguments_are_refused(make: Callable[[], object], sentence: str) -> None:
    """Each call once raised another error or more than one sentence."""
    with pytest.raises(WarehouseError, match=sentence) as raised:
        make()
    assert "\n" not in str(raised.value)


@pytest.mark.filterwarnings("error")
def test_signalling_nan_heights_are_refused_without_a_warning() -> None:
    heights = np.full((2, 2), 0x7FA00000, np.uint32).view(np.float32)
    with pytest.raises(WarehouseError, match="height at"):
        GridMap(np.zeros((2, 2)), height=heights)


def test_encrypted_archive_is_refused_and_closed(tmp_path: Path, recwarn: pytest.WarningsRecorder) -> None:
    content = bytearray(an_episode())
    content[content.index(b"PK\1\2") + 8] |= 1  # flag of the first entry in the central directory
    (tmp_path / "e.npz").write_bytes(content)
    with pytest.raises(WarehouseError, match="encrypted"):
        Episode.load(tmp_path / "e.npz")
    assert not recwarn.list


def test_rows_with_odd_values_are_made_again(tmp_path: Path) -> None:
    (tmp_path / "progress.jsonl").write_text('{"steps": 1}\n{"steps": "x"}\n{"steps": [1]}\n')
    ProgressLog(tmp_path, show=False, steps=5).__exit__(None, None, None)
    assert read_rows(tmp_path / "progress.jsonl") == [{"steps": 1}]
    job = EpisodesJob(make_experiment("follow", EnvConfig(**SMALL), 1, 1.0, 1))
    assert job.left([{"seed": [1], "episode": 0}, {"seed": 1}]) == ([], job)
    block = PlanBlock("000", "", "", 0, "", runs=1, seed=0)
    assert block.left([{"run": {}}, {"run": 0}]) == ([{"run": 0}], None)
