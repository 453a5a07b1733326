"""Test plugins: commands load parts from named files and modules and from nowhere else."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from unittest import mock

import pytest

from agents import add_policy, make_policy, policy_config
from tests.train.test_cli import fails
from train.cli import main
from train.evaluation.fixed_set import Case, benchmark_tables, experiments
from train.job_files import pack
from train.learning import checkpoint
from train.learning.recipes import by_recipe
from train.learning.trainer import first_net
from train.reporting.rows import read_rows
from warehouse_env import LAYOUTS, PLANNERS, EnvConfig, SensorSpec, Simulator, make_layout, make_planner, plugins
from warehouse_env.errors import ConfigError
from warehouse_env.maps.layouts import add_layout
from warehouse_env.observation import SENSORS, add_sensor, observation_layout
from warehouse_env.simulation.tasks.sampled import TASKS

POLICY = '''
import numpy as np
from agents.route_command import RouteCommand
from helper_of_mine import SLOW
from warehouse_env import SensorSpec

class Slow:
    """Follows its route, slowly."""
    needs = {"traffic": "shield"}

    def __init__(self, config):
        self._command = RouteCommand(config)

    def act(self, observation, rng):
        return self._command.at_speed(observation, np.full(observation.shape[:-1], SLOW, np.float32))

class Feeling(Slow):
    needs = {"sensor": SensorSpec(extra="my_sensor.py:Pace")}

class Idle:
    def __init__(self, config):
        pass

class Odd(Slow):
    def act(self, observation, rng):
        return np.zeros(3)

class Broken(Slow):
    def __init__(self, config):
        self.share = 1 / 0
'''
PLANNER = '''
from dataclasses import dataclass
from typing import ClassVar
from warehouse_env.planning import BasePlanner, make_planner

@dataclass(frozen=True)
class Backwards(BasePlanner):
    """Lets another planner search from the goal to the start."""
    inner: str = "astar"
    name: ClassVar[str] = "backwards"

    def find(self, grid, start, goal, rng, cost):
        plan = make_planner(self.inner).plan(grid, goal, start, rng)
        return plan._replace(cells=plan.cells[::-1])

class Aimless:
    pass
'''
LAYOUT = """
import numpy as np
from warehouse_env.traffic_spec import TrafficSpec
from warehouse_env import GridMap

def hall(columns=24):
    occupied = np.zeros((20, columns), dtype=bool)
    occupied[5:16:5, 4:20] = True
    return GridMap(occupied, name="hall")

def three():
    return 3
"""
SENSOR = '''
import numpy as np

class Pace:
    """The speed, and how far the robot has come on its route."""
    size, bounds = 2, (-1.0, 1.0)

    def __init__(self, config, far=50.0):
        self.far = far

    def observe(self, view):
        state = view.state
        return np.stack([state.speed / 1.5, np.tanh(state.route_position / self.far)], axis=-1)

class Sizeless(Pace):
    size = None

class Unbounded(Pace):
    bounds = 3.0

class Flat(Pace):
    def observe(self, view):
        return view.state.speed

class Lost(Pace):
    def observe(self, view):
        return np.full((*view.state.speed.shape, 2), np.nan)

class Fast(Pace):
    def observe(self, view):
        return np.full((*view.state.speed.shape, 2), -1.5)

class Broken(Pace):
    def observe(self, view):
        return view.speed
'''
TASKS_OF_MINE = """
class Rim:
    def __init__(self, config, grid):
        self.cells = [(0, column) for column in range(grid.shape[1])]

    def starts(self, rng):
        return self.cells[1::3]

    def goal(self, rng, robot, at, taken):
        return next(cell for cell in self.cells[5:] if cell not in taken and cell != at)
"""


@pytest.fixture(autouse=True)
def here(registries: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a working folder with a plugin of each kind."""
    files = {"policy": POLICY, "planner": PLANNER, "layout": LAYOUT, "sensor": SENSOR, "tasks": TASKS_OF_MINE}
    for kind, source in files.items():
        (tmp_path / f"my_{kind}.py").write_text(source)
    (tmp_path / "helper_of_mine.py").write_text("SLOW = 0.5\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path


DRIVEN = "--layout my_layout.py:hall:columns=25 --robots 2 --episodes 1 --seconds 4 --no-pictures --out out"


def evaluate(*more: str) -> int:
    return main(["evaluate", *DRIVEN.split(), *more])


@pytest.mark.parametrize("name", ["my_policy.py:Slow", "my_policy:Slow"])
def test_policy_planner_and_layout_run_under_their_typed_names(name: str) -> None:
    assert evaluate("--policy", name, "follow", "--planner", "my_planner.py:Backwards:inner=astar_turns") == 0
    slow, follow = read_rows(Path("out/rows.jsonl"))
    assert (slow["policy"], slow["layout"]) == (name, "my_layout.py:hall:columns=25")
    assert slow["planner"] == "my_planner.py:Backwards:inner=astar_turns"
    assert set(slow["versions"]) == {name, "my_planner.py:Backwards", "my_layout.py:hall"}
    assert (slow["config"]["traffic"], follow["config"]["traffic"]) == ("shield", "none")
    assert 0 < slow["robot_km"] < 0.7 * follow["robot_km"]


INSTALLED = """
import sys
from importlib.machinery import PathFinder

class Installed:  # as pip installs with --editable: found after all that is on sys.path
    def find_spec(name, path=None, target=None):
        ours = path is None and name in ("warehouse_env", "agents", "train")
        return PathFinder.find_spec(name, [{root!r}]) if ours else None

sys.meta_path.insert(sys.meta_path.index(PathFinder) + 1, Installed)
"""


@pytest.mark.nightly
def test_other_files_in_the_folder_do_not_run(here: Path) -> None:
    """Neither this process nor its workers run other files, whatever their names."""
    for name in ("train", "agents", "warehouse_env", "numpy", "ray", "tests", "signal", "pickle"):
        (here / f"{name}.py").write_text("import pathlib\npathlib.Path(__file__).with_suffix('.sprung').touch()\n")
    (here / "site").mkdir()
    (here / "site/sitecustomize.py").write_text(INSTALLED.format(root=str(Path(__file__).parent.parent)))
    command = ["evaluate", *DRIVEN.split(), "--policy", "my_policy.py:Slow", "my_policy:Slow", "--processes", "2"]
    code = f"import sys; from train.cli import main; sys.exit(main({command}))"
    settings = os.environ | {"PYTHONPATH": "site"}
    run = subprocess.run([sys.executable, "-P", "-c", code], env=settings, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert not list(here.glob("*.sprung"))


def test_plugin_packs_its_own_imports(here: Path) -> None:
    (here / "helper_of_mine.py").write_text("import package_of_mine.inner as inner\nSLOW = inner.SLOW\n")
    (here / "package_of_mine").mkdir()
    (here / "package_of_mine/inner.py").write_text("import importlib\nSLOW = importlib.import_module('last').SLOW\n")
    (here / "last.py").write_text("SLOW = 0.25\n")
    add_policy("my_policy.py:Slow")
    assert sys.modules["last"].SLOW == 0.25
    assert find_spec("my_planner") is None
    files = pack([])
    assert set(files["my_policy.py"]) == {
        "my_policy.py", "helper_of_mine.py", "package_of_mine/inner.py", "last.py"
    }  # fmt: skip


def test_loading_a_plugin_keeps_the_search_path(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for first in ([], [str(here)]):  # the working folder may already be on the path
        monkeypatch.setattr(sys, "path", [*first, *sys.path])
        before = list(sys.path)
        add_policy("my_policy.py:Slow" if first else "my_policy:Slow")
        assert sys.path == before


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ("--policy my_policy.py:Slowly", "my_policy.py has no 'Slowly'; did you mean Slow?"),
        ("--policy my_policy.py", "must name what is meant in that file, too, as in my_policy.py:Mine"),
        ("--policy gone.py:Mine", "policy 'gone.py:Mine': there is no file gone.py"),
        ("--policy gone.inner:Mine", "policy 'gone.inner:Mine': there is no module gone here or installed"),
        ("--policy my_policy.py:Slow:a=1", "a policy takes no parameters; leave out 'a=1'"),
        ("--policy my_policy.py:Idle", "my_policy.py:Idle cannot be used as policy: it has no act(observation, rng)"),
        ("--policy my_policy.py:Odd", "must act by an array of whole numbers [1, 2] for [1, 2, 94], not by float64[3]"),
        ("--policy my_policy.py:Broken", "my_policy.py, line 30: ZeroDivisionError: division by zero"),
        ("--policy bad.py:Mine", "bad.py, line 2: SyntaxError"),
        ("--policy missing.py:Mine", "missing.py, line 1: ModuleNotFoundError: No module named 'nowhere'"),
        ("--policy follow --planner my_planner.py:Aimless", "used as planner: it has no plan(grid, start, goal"),
        ("--policy follow --planner my_planner.py:Backwards:iner=3", "Backwards': 'iner'; did you mean inner?"),
        ("--policy follow --layout my_layout.py:three", "is no layout: it returned 3, not a GridMap"),
        ("--policy follow --layout my_layout.py:hall:rows=3", "unknown parameter of layout"),
        ("--policy my_policy.py:Feeling", "sensor 'my_sensor.py:Pace' is code"),
        ("--policy follow --sensor my_sensor.py:Pacer", "my_sensor.py has no 'Pacer'; did you mean Pace?"),
        ("--policy follow --tasks my_policy.py:Idle", "Idle cannot be used as tasks: it has no starts(rng)"),
        ("--policy follow --sensor my_policy.py:Idle", "cannot be used as sensor: it has no observe(view)"),
    ],
)
def test_wrong_plugin_is_one_sentence_before_driving(
    options: str, sentence: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (here / "bad.py").write_text("x = 1\ndef\n")
    (here / "missing.py").write_text("import nowhere\n")
    printed = fails(capsys, "evaluate", *DRIVEN.split(), *options.split())
    assert sentence in printed
    assert not (here / "out").exists()


def test_plugin_name_in_a_file_runs_nothing(here: Path) -> None:
    (here / "trap.py").write_text("import pathlib\npathlib.Path('sprung').touch()\nclass Mine: pass\n")
    name = "trap.py:Mine"
    config = EnvConfig.from_dict({"planner": name, "layout": name, "sensor": {"extra": name}})
    for look in (
        lambda: make_planner(config.planner), lambda: make_layout(config.layout),
        lambda: make_policy("trap.py:Mine", EnvConfig()), lambda: policy_config("trap:Mine", EnvConfig()),
        lambda: observation_layout(config),
    ):  # fmt: skip
        with pytest.raises(ConfigError, match="is code, and runs only where the command itself names it"):
            look()
    assert not (here / "sprung").exists()


def test_recorded_episode_needs_its_planner_and_tasks(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    own = ["--policy", "my_policy.py:Slow", "--planner", "my_planner.py:Backwards", "--tasks", "my_tasks.py:Rim"]
    record = ["record", "--layout", "my_layout.py:hall", "--robots", "2", "--seconds", "2", "--out", "one.npz"]
    assert main([*record, *own]) == 0
    printed = capsys.readouterr().out
    assert printed.endswith("--html one.html " + " ".join(map("=".join, zip(own[::2], own[1::2], strict=True))) + "\n")
    for registry, name in ((PLANNERS, "my_planner.py:Backwards"), (TASKS, "my_tasks.py:Rim")):
        with mock.patch.dict(registry):
            registry.pop(name)
            assert f"'{name}' is code" in fails(capsys, "replay", "one.npz", "--html", "one.html")
    assert main(["replay", "one.npz", "--html", "one.html", *own]) == 0


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("Sizeless", "my_sensor.py:Sizeless has the size None, which must be a whole number from 1 to 4,096"),
        ("Unbounded", "my_sensor.py:Unbounded fails at"),
        ("Flat", "my_sensor.py:Flat must observe an array of numbers [1, 2, 2], not float32[1, 2]"),
        ("Lost", "my_sensor.py:Lost observes nan, which is not finite or beyond its bounds"),
        ("Fast", "my_sensor.py:Fast observes -1.5, which is not finite or beyond its bounds"),
        ("Broken", "my_sensor.py, line 35: AttributeError"),
    ],
)
def test_unusable_sensor_is_named(name: str, sentence: str) -> None:
    add_sensor(f"my_sensor.py:{name}")
    config = EnvConfig(layout="open", num_agents=2, sensor=SensorSpec(extra=f"my_sensor.py:{name}"))
    with pytest.raises(ConfigError) as refused:
        Simulator(config).reset(0)
    assert sentence in str(refused.value)


def test_training_extends_a_policy_without_its_sensor() -> None:
    add_sensor("my_sensor.py:Pace:far=20")
    config = by_recipe("shielded", sensor="my_sensor.py:Pace:far=20", layouts=("open",), robots=(2,), rows=2)
    env = config.env("open", 2)
    parts, own = observation_layout(env).slices, first_net(config, env).state_dict()["actor.0.weight"].numpy()
    assert list(parts)[-2:] == ["extra", "field"]
    assert own[:, : parts["extra"].start].any()
    assert not own[:, parts["extra"].start :].any()


SMALL = "--robots 2 --rows 4 --rollout 6 --minibatch 24 --hidden 24 --episode-seconds 3 --threads 1 --no-progress"


@pytest.mark.parametrize("trainer", ["reinforce", "unshielded", "ppo"])
def test_trained_policy_needs_and_keeps_its_sensor(
    trainer: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    own = ["--sensor", "my_sensor.py:Pace:far=20"]
    begin = f"train {trainer} {SMALL} --evaluation-seconds 0 --layout my_layout.py:hall --steps 24 --out . --name run"
    assert main([*begin.split(), "--traffic", "none", *own]) == 0
    capsys.readouterr()
    digest = plugins.digests(own[1])["my_sensor.py:Pace"]
    assert f"| my_sensor.py:Pace (version) | {digest} |" in Path("run/CARD.md").read_text()
    SENSORS.clear()
    for command in (["evaluate", *DRIVEN.split(), "--policy", "run"], ["train", trainer, "--resume", "run"]):
        assert "by --sensor 'my_sensor.py:Pace'" in fails(capsys, *command)
    assert evaluate("--policy", "run", "my_policy.py:Feeling", "follow", *own) == 0
    trained, feeling, follow = read_rows(Path("out/rows.jsonl"))
    assert trained["config"]["sensor"]["extra"] == own[1]
    assert feeling["config"]["sensor"]["extra"] == "my_sensor.py:Pace"
    assert trained["versions"]["my_sensor.py:Pace"] == feeling["versions"]["my_sensor.py:Pace"] == digest
    assert (follow["config"]["sensor"]["extra"], set(follow["versions"])) == (None, {"my_layout.py:hall"})
    record = ["record", "--policy", "run", "--layout", "my_layout.py:hall", "--robots", "2", "--seconds", "2", *own]
    assert main([*record, "--out", "one.npz"]) == 0
    assert capsys.readouterr().out.endswith("--html one.html --sensor=my_sensor.py:Pace:far=20\n")
    assert main(["replay", "one.npz", "--html", "one.html", *own]) == 0
    assert "preferences" not in capsys.readouterr().err
    SENSORS.clear()
    assert main(["replay", "one.npz", "--html", "two.html"]) == 0  # only the policy needs the sensor
    assert "without the policy's preferences: sensor 'my_sensor.py:Pace' is code" in capsys.readouterr().err
    small = (Case("own", "my_layout.py:hall", 2, 1),)
    Path("none.jsonl").touch()
    monkeypatch.setattr("train.evaluation.fixed_set.SECONDS", 2.0)
    monkeypatch.setattr("train.commands.evaluate.SHIPPED", Path("none.jsonl"))
    monkeypatch.setattr("train.commands.evaluate.experiments", lambda policy: experiments(policy, small))
    monkeypatch.setattr("train.commands.evaluate.benchmark_tables", lambda rows: benchmark_tables(rows, small))
    add_layout("my_layout.py:hall")
    assert main(["benchmark", "--policy", "run", "--out", "board", "--processes", "1", *own]) == 0
    assert {row["versions"]["my_sensor.py:Pace"] for row in read_rows(Path("board/rows.jsonl"))} == {digest}


@pytest.mark.nightly
def test_training_resumes_with_its_plugins(capsys: pytest.CaptureFixture[str]) -> None:
    own = ["--layout", "my_layout.py:hall", "--planner", "my_planner.py:Backwards", "--tasks", "my_tasks.py:Rim"]
    begin = ["train", "reinforce", *SMALL.split(), "--steps", "24", "--out", ".", "--name", "run", *own]
    assert main(begin) == 0
    LAYOUTS.pop("my_layout.py:hall")
    capsys.readouterr()
    assert main(["train", "reinforce", "--resume", "run", "--no-progress"]) == 2
    assert "layout 'my_layout.py:hall' is code" in capsys.readouterr().err
    assert main(["train", "reinforce", "--resume", "run", "--no-progress", *own]) == 0
    saved = checkpoint.read(Path("run/checkpoint"))
    other = saved.data | {"code": saved.data["code"] | {"my_planner.py:Backwards": "another"}}
    checkpoint.write(Path("run/checkpoint"), saved.arrays, other)
    capsys.readouterr()
    assert main(["train", "reinforce", "--resume", "run", "--no-progress", *own]) == 2
    assert "my_planner.py:Backwards is not the code that run was trained with" in capsys.readouterr().err
