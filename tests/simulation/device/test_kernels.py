"""Kernels of a GPU as far as they show without one: their code, their parameters, memory, and what is missing."""

from __future__ import annotations

import ctypes
import functools
import importlib.util
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
import torch
from numba.np.numpy_support import as_dtype

from tests.simulation.device.test_device import ON_CARD, RULES, SETS, compare, config
from tests.simulation.worlds import ROOT, plain_python
from train.cli import main
from train.evaluation import kernels
from warehouse_env import ConfigError, Simulator
from warehouse_env.config import FleetPart, RobotSpec
from warehouse_env.simulation.device import memory, shim, simulator
from warehouse_env.simulation.device.simulator import DeviceSimulator

ALL = SETS["errors and losses"] | SETS["predictions"] | {"traffic": RULES}
NOISE, TASKS = ("rank", "draw", "begin_errors"), ("place", "give")
DRIVERS = ("decide", "resolve", "advance", "search", "survey", "plan", "observe", *NOISE, *TASKS)
HAS_NUMBA_CUDA = importlib.util.find_spec("numba_cuda") is not None


class Noting(memory.CompilerMemory):
    """Memory of a GPU's layout that notes launches."""

    def __init__(self) -> None:
        super().__init__((9, 0))
        self.launched: dict[Any, tuple[int, Any]] = {}  # driver -> threads and batch

    def launch(self, driver: Any, threads: int, batch: Any) -> None:
        self.launched[driver] = threads, batch


def launched(worlds: int, robots: int, **more: Any) -> dict[Any, tuple[int, Any]]:
    """What a reset and a step with everything on launch."""
    noting = Noting()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(simulator, "memory_of", lambda device: noting)
        sim = DeviceSimulator(config(**ALL, **more, num_agents=robots), worlds)
    sim.reset(0)
    sim.step(torch.zeros(worlds, robots, len(sim.host.actions.table)))
    return noting.launched


once = functools.cache(launched)
FLEET = {"fleet": (FleetPart(1, RobotSpec(max_speed=1.0)),)}
POSES = {"arrival": "pose", "layout": "open"}


def test_worlds_of_all_sizes_share_kernels() -> None:
    """So kernels that are compiled ahead, for one small world, serve all."""
    kinds = [{one: numba.typeof(given) for one, given in launched(*size).items()} for size in ((1, 1), (3, 2), (1, 9))]
    assert kinds[0] == kinds[1] == kinds[2]
    assert {driver.__name__ for driver in kinds[0]} == set(DRIVERS)
    for given in launched(1, 1).values():  # nothing stays on the host
        assert {type(one) for one in shim.parameters_of(given) if not isinstance(one, np.generic)} <= {int}


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("name", "more"),
    [*((name, {}) for name in DRIVERS), ("advance", FLEET), ("decide", FLEET), ("advance", POSES), ("search", POSES)],
)
def test_a_kernel_rounds_as_the_cpu_does_and_takes_what_is_launched(name: str, more: dict[str, Any]) -> None:
    """PTX without fused, approximate or flushing arithmetic: `make cuda` compiles it, and needs no GPU."""
    pytest.importorskip("numba_cuda")
    ((driver, launch),) = ((one, launch) for one, launch in once(4, 3, **more).items() if one.__name__ == name)
    ptx = shim.compile_ptx(driver, (9, 0), *launch)
    # the search of curves to poses rounds after double-precision sines (shots.py)
    kinds = "32" if name == "search" and more == POSES else "32|64"
    done = set(re.findall(rf"\b(?:add|sub|mul|div|fma|mad|sqrt|rcp|rsqrt|sin|cos|ex2|lg2)\.[a-z.]*f(?:{kinds})", ptx))
    assert "add.rn.f32" in done or name in NOISE + TASKS
    assert [one for one in done if not re.fullmatch(r"(add|sub|mul|div|sqrt|rcp)\.rn\.f(32|64)", one)] == []
    sizes = [int(bits) // 8 for bits in re.findall(rf"\.param \.[a-z](\d+) {name}_param_\d+[,\n]", ptx)]
    given = [getattr(one, "nbytes", 8) for one in shim.parameters_of(launch)]
    assert given == sizes
    assert sum(sizes) < 32764  # the most that a GPU takes


class Strided(memory.CompilerMemory):
    """Memory of a GPU's layout, its scratch full of rubbish, on which drivers run in Python, thread after thread."""

    def scratch(self, threads: int, array: Any) -> Any:
        view = super().scratch(threads, array)
        view.memory.fill_(0xA5)
        return view

    def launch(self, driver: Any, threads: int, batch: Any) -> None:
        arrays = as_kernels_see(batch)
        for thread in range(threads):
            driver(thread, threads, arrays)


def as_kernels_see(one: Any) -> Any:
    """Replace arrays by NumPy's, from the parameters that a kernel gets."""
    if isinstance(one, shim.DeviceArray):
        address, *rest = one.parameters[4:]
        bytes_, axes = (ctypes.c_byte * one.memory.numel()).from_address(address), len(one.shape)
        return np.ndarray(rest[:axes], as_dtype(one._numba_type_.dtype), bytes_, 0, rest[axes:])
    if isinstance(one, tuple):
        parts = map(as_kernels_see, one)
        return type(one)(*parts) if hasattr(one, "_fields") else tuple(parts)
    return one


def drive_strided(steps: int) -> None:
    """Compare worlds of such memory with the Simulator's, in plain Python."""
    simulator.memory_of = lambda device: Strided((9, 0))
    given = config(**ALL, num_agents=3, layout="open", planner="astar")
    compare(Simulator(given, 3), DeviceSimulator(given, 3), steps)


@pytest.mark.nightly
def test_threads_find_their_scratch_side_by_side() -> None:
    plain_python("from tests.simulation.device.test_kernels import drive_strided as drive; drive(30)")


def drive_on_card(steps: int) -> None:
    """Compare few worlds on a GPU with the Simulator's."""
    given = config(**ALL, num_agents=3)
    compare(Simulator(given, 3), DeviceSimulator(given, 3, device="cuda"), steps)


@ON_CARD
@pytest.mark.nightly
@pytest.mark.skipif(shutil.which("compute-sanitizer") is None, reason="needs compute-sanitizer")
def test_no_kernel_leaves_its_arrays() -> None:
    drive_on_card(5)  # so kernels are on disk
    program = "from tests.simulation.device.test_kernels import drive_on_card as drive; drive(5)"
    done = subprocess.run(
        ["compute-sanitizer", "--error-exitcode", "9", sys.executable, "-c", program], cwd=ROOT,
        env=os.environ | {"PYTORCH_NO_CUDA_MEMORY_CACHING": "1"}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]


def test_kernels_that_were_compiled_ahead_are_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("numba_cuda")
    empty = ".version 8.0\n.target sm_89\n.address_size 64\n.visible .entry {}() {{ ret; }}"
    monkeypatch.setattr(shim, "compile_ptx", lambda driver, *_: empty.format(driver.__name__))
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    for given in kernels.CARD_SETS.values():
        kernels.compile_for_card(given, "8.9")
    monkeypatch.setattr(shim, "compile_ptx", None)
    for given in kernels.CARD_SETS.values():
        sim = DeviceSimulator(given.replace(num_agents=9), 5, device="compiler:8.9")
        assert sim.step(kernels.no_actions(sim)).shape[:2] == (5, 9)
    sim = DeviceSimulator(kernels.CARD_SETS["predictions"], device="compiler:9.0")
    with pytest.raises(TypeError, match="NoneType"):  # another architecture: compiles
        sim.step(kernels.no_actions(sim))


@pytest.mark.parametrize(
    ("built_for", "count", "said"),
    [(None, 0, "without CUDA"), ("13.0", 0, "finds no GPU"), ("13.0", 2, "no GPU cuda:7: the last one is cuda:1")],
)
def test_what_a_gpu_lacks_is_said(
    built_for: str | None, count: int, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shim, "cuda", lambda: None)
    monkeypatch.setattr(torch.version, "cuda", built_for)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: count)
    with pytest.raises(ConfigError, match=said):
        memory.memory_of("cuda:7")


def test_compiling_says_what_is_missing(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compile", "--cuda", "3.0"]) == 2
    assert ("not '3.0'" if HAS_NUMBA_CUDA else "pip install 'warehouse-env[cuda]'") in capsys.readouterr().err
