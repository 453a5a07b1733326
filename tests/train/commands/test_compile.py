"""Test that compiling ahead of time leaves no kernel to compile while driving or planning."""

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
def test_no_kernel_is_left_to_compile() -> None:
    done = subprocess.run([sys.executable, "-c", NOTHING_IS_LEFT], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "[]"


def test_compile_runs_every_part_in_processes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert main(["compile", "--processes", "2"]) == 0
    printed = capsys.readouterr().out
    assert all(part in printed for part in PARTS)
    assert "in 2 processes" in printed
    assert is_compiled()
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path))
    assert not is_compiled()
