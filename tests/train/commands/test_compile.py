"""Compiling ahead of time: after it, nothing that drives or plans calls for a kernel that is not there."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from train.cli import main
from train.evaluation.kernels import PARTS, is_compiled

NOTHING_IS_LEFT = """
import sys
from train.evaluation.kernels import PARTS

def compiled():
    return {
        (name, variable, signature)
        for name, module in list(sys.modules.items()) if name.split(".")[0] in ("warehouse_env", "agents")
        for variable, value in vars(module).items()
        for signature in getattr(value, "overloads", ())
    }

for part in PARTS.values():
    part()
known = compiled()
assert known, "no kernel was called"

from train.evaluation.rollout import make_experiment, run
from warehouse_env import EnvConfig, parallel_env
for policy in ("brake", "greedy", "ppo", "shielded"):
    run(make_experiment(policy, EnvConfig(num_agents=16), 2, 10.0, 3))
env = parallel_env(num_agents=3)
env.reset(seed=1)
env.step({agent: 0 for agent in env.agents})
print(sorted(compiled() - known, key=str))
"""


@pytest.mark.nightly
def test_nothing_is_left_to_compile() -> None:
    done = subprocess.run([sys.executable, "-c", NOTHING_IS_LEFT], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "[]"


def test_every_part_runs_in_processes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert main(["compile", "--processes", "2"]) == 0
    said = capsys.readouterr().out
    assert all(part in said for part in PARTS)
    assert "in 2 processes" in said
    assert is_compiled()
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path))
    assert not is_compiled()
