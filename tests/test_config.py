"""Test options: types for type checkers, stored forms old and new, and one sentence for a wrong value."""

from __future__ import annotations

import dataclasses
import json
import subprocess
import sys
from pathlib import Path
from typing import Any, ClassVar, get_args, get_type_hints

import numpy as np
import pytest

from train.learning.config import ReinforceConfig, ThreadedPPOConfig
from warehouse_env.checked import Checked, from_plain
from warehouse_env.config import ConfigChanges, EnvConfig, RobotSpec, TrafficMode
from warehouse_env.errors import ConfigError
from warehouse_env.simulation.state import latency_steps
from warehouse_env.traffic_spec import TRAFFIC, ErrorBounds, TrafficSpec, UncertaintySpec, read_traffic, written_traffic
from warehouse_env.work import BatterySpec, OrderSpec, ServiceSpec

ROOT = Path(__file__).parent.parent
CONFIG = ROOT / "warehouse_env" / "config.py"


def with_option_types(source: str) -> str:
    """Return the source of config.py with EnvOptions' fields copied from EnvConfig."""
    fields = (f"    {one.name}: {one.type}\n" for one in dataclasses.fields(EnvConfig) if one.name != "planner")
    before, head, after = source.partition('may be an object there."""\n\n')
    return before + head + "".join(fields) + after[after.index("\n\n") + 1 :]


def test_type_checkers_know_every_option() -> None:
    source = CONFIG.read_text(encoding="utf-8")
    assert with_option_types(source) == source, "run python -m tests.test_config"
    fields = {field.name: get_type_hints(EnvConfig)[field.name] for field in dataclasses.fields(EnvConfig)}
    assert get_type_hints(ConfigChanges) == fields


RIGHT = """
import warehouse_env
from warehouse_env import EnvConfig, SensorSpec

rows = warehouse_env.vec_env(4, num_agents=8, layout="open", planner=warehouse_env.make_planner("astar"))
env = warehouse_env.parallel_env(num_agents=8, sensor=SensorSpec(rays=16), planner="astar", render_mode="rgb_array")
turns = warehouse_env.aec_env(EnvConfig(), tasks="one_shot", grid=warehouse_env.make_layout("open"))
one = warehouse_env.single_env(num_agents=2, others=lambda observation: [0])
other = env.config.replace(planner="astar", people=2)
"""
SLIPS = {
    "warehouse_env.parallel_env(num_agnts=8)": 'Unexpected keyword argument "num_agnts"',
    "warehouse_env.aec_env(num_agnts=8)": 'Unexpected keyword argument "num_agnts"',
    "warehouse_env.single_env(num_agnts=8)": 'Unexpected keyword argument "num_agnts"',
    "warehouse_env.vec_env(4, num_agnts=8)": 'Unexpected keyword argument "num_agnts"',
    "warehouse_env.WarehouseParallelEnv(num_agnts=8)": 'Unexpected keyword argument "num_agnts"',
    "EnvConfig().replace(num_agnts=8)": 'Unexpected keyword argument "num_agnts"',
    'warehouse_env.parallel_env(num_agents="8")': 'incompatible type "str"; expected "int"',
    'EnvConfig().replace(traffic="rulez")': "incompatible type \"Literal['rulez']\"",
    'EnvConfig().replace(arrival="stops")': "incompatible type \"Literal['stops']\"",
}


@pytest.mark.nightly
def test_mypy_refuses_wrong_calls_and_accepts_right_ones(tmp_path: Path) -> None:
    pytest.importorskip("mypy")
    snippet = tmp_path / "snippet.py"
    snippet.write_text("\n".join([RIGHT, *SLIPS]), encoding="utf-8")
    command = [sys.executable, "-m", "mypy", "--no-color-output", "--no-error-summary", str(snippet)]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    errors = [line for line in run.stdout.splitlines() if ": error: " in line]
    first = RIGHT.count("\n") + 2
    assert [int(line.split(":")[1]) - first for line in errors] == list(range(len(SLIPS))), run.stdout + run.stderr
    assert [line for line, message in zip(errors, SLIPS.values(), strict=True) if message not in line] == []


def test_presets_are_stored_by_name_and_no_uncertainty_as_none() -> None:
    for name, spec in TRAFFIC.items():
        config = EnvConfig(traffic=dataclasses.replace(spec), uncertainty=UncertaintySpec())
        assert (config.traffic, config.traffic_spec, config.uncertainty) == (name, spec, None)
        assert config == EnvConfig(traffic=name)  # type: ignore[arg-type]
    assert set(get_args(TrafficMode)) == set(TRAFFIC)


@pytest.mark.parametrize(
    "spec", [*TRAFFIC.values(), TrafficSpec(shield=True, margin=0.1), TrafficSpec(routes="barred")]
)
def test_traffic_round_trips(spec: TrafficSpec) -> None:
    assert read_traffic(written_traffic(spec)) == spec
    assert EnvConfig.from_dict(json.loads(json.dumps(EnvConfig(traffic=spec).to_dict()))).traffic_spec == spec


def test_shield_uses_the_true_bounds_unless_others_are_declared() -> None:
    late, declared = UncertaintySpec(latency=0.3), UncertaintySpec(latency=0.3, declared=ErrorBounds())
    assert [latency_steps(EnvConfig(traffic="shield", uncertainty=one)) for one in (late, declared)] == [3, 0]
    assert late.bounds is late
    assert not declared.errs
    assert UncertaintySpec(pose_error=0.1).errs


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"keep_right": "x"}, "keep_right='x' must be a finite number"),
        ({"keep_right": True}, "keep_right=True must be a finite number"),
        ({"keep_right": 10**400}, "keep_right=10"),
        ({"speed_levels": 3}, "speed_levels=3 must be a list with a finite number in each place"),
        ({"speed_levels": "12"}, "speed_levels='12' must be a list"),
        ({"speed_levels": []}, r"speed_levels=\(\) must be 1 to 4096 numbers"),
        ({"lateral_offsets": [0.1] * 2000}, "lateral_offsets=.* must be at most 1024 numbers beside 4 speed_levels"),
        ({"num_agents": 2.0}, r"num_agents=2\.0 must be a whole number"),
        ({"num_agents": 10**9}, "num_agents=1000000000 must be a whole number from 1 to 100,000"),
        ({"num_agents": 10**5000}, "a value of type int"),
        ({"tasks": ["lifelong"]}, r"tasks=\['lifelong'\] must be a text"),
        ({"layout": 3}, "layout=3 must be a text"),
        ({"service": 3}, "service=3 must be a ServiceSpec or None"),
        ({"traffic": "rulez"}, "traffic='rulez' must be one of none, routes, shield, rules, assist or a TrafficSpec"),
        ({"robot": None}, "robot=None must be a RobotSpec"),
        ({"sensor": RobotSpec()}, "sensor=.* must be a SensorSpec"),
        ({"time_step": 1e-30}, "time_step=1e-30 must be a number from 0.001 to 10"),
        ({"stuck_after": float("inf")}, "stuck_after=inf must be a finite number"),
        ({"traffic": "rules", "action_type": "raw"}, "raw"),
        ({"service": ServiceSpec()}, 'set arrival="stop"'),
        ({"orders": OrderSpec(), "arrival": "stop", "tasks": "one_shot"}, "lifelong"),
        ({"battery": BatterySpec(), "arrival": "stop", "terminate_on_collision": True}, "no collision"),
        ({"service": ServiceSpec(load=900.0), "arrival": "stop"}, "payload of 500 kg"),
    ],
)
def test_wrong_values_are_named(changes: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ConfigError, match=sentence):
        EnvConfig(**changes)
    with pytest.raises(ConfigError, match=sentence):
        EnvConfig().replace(**changes)


def test_numbers_become_plain_python() -> None:
    config = EnvConfig(
        num_agents=np.int8(3), keep_right=np.float32(1), time_step=1, terminate_on_collision=np.bool_(True),
        speed_levels=np.array([1, 2]), lateral_offsets=[0, np.int64(1)], layout=Path("a/b.map"),  # type: ignore[arg-type]
    )  # fmt: skip
    plain = EnvConfig(
        num_agents=3, keep_right=1.0, time_step=1.0, terminate_on_collision=True, speed_levels=(1.0, 2.0),
        lateral_offsets=(0.0, 1.0), layout="a/b.map",
    )  # fmt: skip
    assert repr(config) == repr(plain)
    assert hash(config) == hash(plain)


def test_from_dict_names_the_wrong_entry() -> None:
    for data, sentence in (
        ([1], r"EnvConfig parameters must be an object of names and values, not \[1\]"),
        ({"robot": None}, "robot=None must be a RobotSpec"),
        ({"robot": {"width": "x"}}, "width='x'"),
        ({"traffic": {"margin": -0.1}}, "margin=-0.1"),
        ({"orders": {"demand": [0.5, 0.2], "faces": [0.5, 0.5]}}, "shares that make 1"),
        ({"battery": {"low": 0.9, "full": 0.5}}, "less than full"),
        ({"robot": {"widht": 1}}, "did you mean width"),
        ({1: 2}, "unknown EnvConfig parameter 1"),
        ({"smooth_routes": True}, "EnvConfig parameter 'smooth_routes' is no option any more: it is False for all"),
    ):
        with pytest.raises(ConfigError, match=sentence):
            EnvConfig.from_dict(data)  # type: ignore[arg-type]


@dataclasses.dataclass(frozen=True)
class Wheel(Checked):
    size: float = 1.0
    retired: ClassVar[dict[str, Any]] = {"spokes": 8}


@dataclasses.dataclass(frozen=True)
class Cart(Checked):
    wheel: Wheel = dataclasses.field(default_factory=Wheel)


def test_retired_field_is_ignored_at_its_fixed_value() -> None:
    """Files with such a field stay readable."""
    assert EnvConfig.from_dict({"smooth_routes": False, "search_nodes": 6000, "search_period": 1}) == EnvConfig()
    assert from_plain(Cart, {"wheel": {"size": 2, "spokes": 8}}) == Cart(Wheel(2.0))
    with pytest.raises(ConfigError, match="Wheel parameter 'spokes' is no option any more: it is 8 for all"):
        from_plain(Cart, {"wheel": {"spokes": 9}})


SHIELD = TrafficSpec(shield=True)
OLD: list[tuple[dict[str, Any], dict[str, Any]]] = [  # stored fields -> present fields
    ({"map_file": "hall.map", "layout": "narrow"}, {"layout": "hall.map"}),
    ({"map_file": None, "layout": "narrow"}, {"layout": "narrow"}),
    ({"protective_field": True}, {"traffic": SHIELD}),
    ({"protective_field": False, "right_of_way": False, "reroute": False}, {"traffic": "none"}),
    ({"protective_field": True, "field_margin": 0.1}, {"traffic": TrafficSpec(shield=True, margin=0.1)}),
    ({"protective_field": True, "right_of_way": True}, {"traffic": TrafficSpec(shield=True, right_of_way=True)}),
    ({"protective_field": True, "right_of_way": True, "reroute": True}, {"traffic": "rules"}),
    (
        {"protective_field": True, "right_of_way": True, "right_of_way_after": 12.0, "reroute": True},
        {"traffic": TrafficSpec(shield=True, routes=True, right_of_way=True, right_of_way_after=12.0)},
    ),
    ({"reroute": True}, {"traffic": "routes"}),
    ({"reroute": True, "reroute_spec": {"only_barred": True, "every": 4.0}}, {"traffic": TrafficSpec(routes="barred")}),
    ({"reroute": False, "reroute_spec": {"only_barred": True, "every": 1.0}}, {"traffic": "none"}),
    ({"reroute": True, "planner": "astar", "reroute_spec": {"planner": "astar"}}, {"traffic": "routes"}),
    (
        {"protective_field": True, "field_spec": {"scanner_rays": 36, "unseen_speed": 1.5}}, {"traffic": SHIELD},
    ),
    ({"message_loss": 0.1, "message_burst": 5.0}, {"uncertainty": UncertaintySpec(loss=0.1, burst=5.0)}),
    ({"message_loss": 0.0, "field_spec": {}}, {"uncertainty": None}),
    ({"message_latency": 0.3}, {"uncertainty": UncertaintySpec(latency=0.3, declared=ErrorBounds())}),
    ({"message_latency": 0.3, "field_spec": {"latency": 0.3}}, {"uncertainty": UncertaintySpec(latency=0.3)}),
    ({"field_spec": {"latency": 0.3}}, {"uncertainty": UncertaintySpec(declared=ErrorBounds(latency=0.3))}),
    *(
        ({name: 0.02, "field_spec": {name: bound}}, {"uncertainty": UncertaintySpec(**{name: 0.02}, declared=declared)})
        for name in ("pose_error", "heading_error", "actuation_error")
        for bound, declared in ((0.02, None), (0.03, ErrorBounds(**{name: 0.03})))
    ),
]  # fmt: skip


@pytest.mark.parametrize(("stored", "today"), OLD)
def test_old_names_keep_their_meaning(stored: dict[str, Any], today: dict[str, Any]) -> None:
    planner = {name: stored[name] for name in ("planner",) if name in stored}
    assert EnvConfig.from_dict(stored) == EnvConfig(**planner, **today)


@pytest.mark.parametrize(
    ("stored", "sentence"),
    [
        ({"traffic": "rules", "reroute": True}, "'reroute' is an old name of what 'traffic' says"),
        ({"uncertainty": None, "message_loss": 0.1}, "'message_loss' is an old name of what 'uncertainty' says"),
        ({"right_of_way": True}, "False without a shield"),
        ({"protective_field": 3}, r"TrafficSpec\.shield=3 must be True or False"),
        ({"reroute_spec": 3}, "reroute_spec must be an object"),
        ({"reroute": True, "reroute_spec": {"every": 2.0}}, r"'every' is no option any more: it is 4\.0 for all"),
        ({"reroute": True, "reroute_spec": {"evry": 2.0}}, "unknown TrafficSpec parameter 'evry'"),
        ({"field_spec": {"latncy": 0.3}}, "did you mean latency"),
        ({"protective_field": "lidar"}, r"TrafficSpec\.shield='lidar' must be True or False"),
        ({"map_file": 3}, "layout=3 must be a text"),
    ],
)
def test_contradictory_stored_options_are_refused(stored: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ConfigError, match=sentence):
        EnvConfig.from_dict(stored)


@pytest.mark.parametrize(
    ("kind", "stored", "traffic"),
    [
        (ReinforceConfig, {}, "routes"),
        (ReinforceConfig, {"protective_field": False, "reroute": False, "right_of_way_after": None}, "none"),
        (ReinforceConfig, {"protective_field": True, "right_of_way_after": 0.0}, "rules"),
        (ThreadedPPOConfig, {"right_of_way_after": None}, "shield"),
        (ThreadedPPOConfig, {"reroute": True}, "assist"),
        (
            ThreadedPPOConfig,
            {"right_of_way_after": 6.0},
            dataclasses.replace(TRAFFIC["assist"], right_of_way_after=6.0),
        ),
    ],
)
def test_stored_trainings_keep_their_traffic(kind: Any, stored: dict[str, Any], traffic: Any) -> None:
    spec = TRAFFIC[traffic] if isinstance(traffic, str) else traffic
    assert from_plain(kind, stored).traffic_spec == spec
    assert from_plain(kind, from_plain(kind, stored).to_dict()) == from_plain(kind, stored)
    with pytest.raises(ConfigError, match="unknown"):
        from_plain(kind, {"traffic": "rules", "reroute": True})


if __name__ == "__main__":
    CONFIG.write_text(with_option_types(CONFIG.read_text(encoding="utf-8")), encoding="utf-8")
