"""The options: what type checkers know of them, and what `help` says."""

from __future__ import annotations

import dataclasses
import json
import subprocess
import sys
from pathlib import Path
from typing import get_args, get_type_hints

import pytest

from warehouse_env.config import ConfigChanges, EnvConfig, TrafficMode
from warehouse_env.simulation.state import latency_steps
from warehouse_env.traffic_spec import TRAFFIC, ErrorBounds, TrafficSpec, UncertaintySpec, read_traffic, written_traffic

ROOT = Path(__file__).parent.parent
CONFIG = ROOT / "warehouse_env" / "config.py"


def with_option_types(source: str) -> str:
    """Return the source of config.py with the fields of EnvOptions as EnvConfig has them."""
    fields = (f"    {one.name}: {one.type}\n" for one in dataclasses.fields(EnvConfig) if one.name != "planner")
    before, head, after = source.partition('may be an object there."""\n\n')
    return before + head + "".join(fields) + after[after.index("\n\n") + 1 :]


def test_type_checkers_know_every_option_by_its_type() -> None:
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
    'EnvConfig().replace(tasks="one_shots")': "incompatible type \"Literal['one_shots']\"",
}


@pytest.mark.nightly
def test_mypy_refuses_slips_and_lets_right_calls_pass(tmp_path: Path) -> None:
    pytest.importorskip("mypy")
    snippet = tmp_path / "snippet.py"
    snippet.write_text("\n".join([RIGHT, *SLIPS]), encoding="utf-8")
    command = [sys.executable, "-m", "mypy", "--no-color-output", "--no-error-summary", str(snippet)]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    errors = [line for line in run.stdout.splitlines() if ": error: " in line]
    first = RIGHT.count("\n") + 2
    assert [int(line.split(":")[1]) - first for line in errors] == list(range(len(SLIPS))), run.stdout + run.stderr
    assert [line for line, said in zip(errors, SLIPS.values(), strict=True) if said not in line] == []


def test_a_preset_is_kept_by_its_name_and_nothing_uncertain_as_none() -> None:
    for name, spec in TRAFFIC.items():
        config = EnvConfig(traffic=dataclasses.replace(spec), uncertainty=UncertaintySpec())
        assert (config.traffic, config.traffic_spec, config.uncertainty) == (name, spec, None)
        assert config == EnvConfig(traffic=name)  # type: ignore[arg-type]
    assert set(get_args(TrafficMode)) == set(TRAFFIC)


@pytest.mark.parametrize(
    "spec", [*TRAFFIC.values(), TrafficSpec(shield=True, margin=0.1), TrafficSpec(routes="barred")]
)
def test_traffic_is_read_as_it_is_written(spec: TrafficSpec) -> None:
    assert read_traffic(written_traffic(spec)) == spec
    assert EnvConfig.from_dict(json.loads(json.dumps(EnvConfig(traffic=spec).to_dict()))).traffic_spec == spec


def test_the_shield_counts_on_the_real_bounds_unless_others_are_declared() -> None:
    late, declared = UncertaintySpec(latency=0.3), UncertaintySpec(latency=0.3, declared=ErrorBounds())
    assert [latency_steps(EnvConfig(traffic="shield", uncertainty=one)) for one in (late, declared)] == [3, 0]
    assert late.bounds is late
    assert not declared.errs
    assert UncertaintySpec(pose_error=0.1).errs


if __name__ == "__main__":
    CONFIG.write_text(with_option_types(CONFIG.read_text(encoding="utf-8")), encoding="utf-8")
