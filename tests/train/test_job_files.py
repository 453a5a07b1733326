"""What jobs read goes with them: it is found under its name, where no such file lies."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from agents import WEIGHTS_FOLDER, make_policy, policy_config
from train.job_files import pack, unpacked
from train.own import take_in, versions
from warehouse_env import EnvConfig, make_layout
from warehouse_env.errors import MapError, WeightsError
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.maps.movingai import write_map


def test_a_map_with_its_directions_and_a_policy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    occupied = np.zeros((6, 8), bool)
    occupied[2, 2] = True
    one_way = np.zeros((6, 8), np.uint8)
    one_way[3, 3] = 1
    Path("halls").mkdir()
    write_map(GridMap(occupied, one_way=one_way), "halls/mine.map")
    shutil.copytree(WEIGHTS_FOLDER / "ppo", "runs/mine")
    names = ("halls/mine.map", "runs/mine", "greedy", "pf_aco", "")
    digest, files = versions("runs/mine", "pf_aco", "paper46"), pack(names)
    assert list(files) == ["halls/mine.map", "runs/mine"]
    shutil.rmtree("halls")
    shutil.rmtree("runs")
    with unpacked(files):
        grid = make_layout("halls/mine.map")
        assert grid.name == "mine"
        assert grid.one_way[3, 3] == 1
        config = policy_config("runs/mine", EnvConfig())
        assert make_policy("runs/mine", config) is not None
        assert versions("runs/mine", "pf_aco", "paper46") == digest
    with pytest.raises(MapError):
        make_layout("halls/mine.map")
    with pytest.raises(WeightsError):
        make_policy("runs/mine", config)


@pytest.mark.usefixtures("registries")
@pytest.mark.parametrize("name", ["mine.py:Mine", "mine:Mine"])
def test_code_of_ones_own(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from agents import POLICIES
    from warehouse_env.plugins import LOADED

    monkeypatch.chdir(tmp_path)
    home, _, _ = name.partition(":")
    beside = f"beside_{home.replace('.', '_')}"  # of its own: what was imported of a files stays imported
    Path("mine.py").write_text(f"from {beside} import Mine\n")
    Path(f"{beside}.py").write_text("from agents.path_following import Follow as Mine\n")
    take_in([("policy", name)])
    files = pack(())
    assert {one: list(own) for one, own in files.items()} == {home: ["mine.py", f"{beside}.py"]}
    for module in ("mine", beside):
        Path(f"{module}.py").unlink()
        sys.modules.pop(module, None)
    del LOADED[name], POLICIES[name]
    with unpacked(files):
        take_in([("policy", name)])
        assert make_policy(name, EnvConfig())
