"""Test which module may import which, read from the source, and what `import warehouse_env` may load."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

import warehouse_env

ROOT = Path(__file__).parent.parent
PACKAGES = ("warehouse_env", "agents", "train")

BASE = tuple(
    f"warehouse_env.{name}"
    for name in (
        "errors", "checked", "config", "files", "format_version", "heap", "kernel", "old_names", "plugins",
        "portable", "threads", "traffic_spec", "work",
    )
)  # fmt: skip
PLANNING = (*BASE, "warehouse_env.maps", "warehouse_env.planning")
ROUTES = (*PLANNING, "warehouse_env.routes")
SIMULATION = (*ROUTES, "warehouse_env.observation", "warehouse_env.simulation")
# Layers of the simulation from the bottom up: each imports lower layers and the records of `state`.
DOOR = "warehouse_env.simulation.state", "warehouse_env.simulation.draws"
PHYSICS = (*BASE, "warehouse_env.maps", *DOOR, "warehouse_env.simulation.physics")
# A driver follows Reeds-Shepp curves, which know no map; it imports no other part of routes.
DRIVER = (*PHYSICS, "warehouse_env.routes.reeds_shepp", "warehouse_env.simulation.driver")
SENSES = (*DRIVER, "warehouse_env.observation", "warehouse_env.simulation.senses")
RULES = (*ROUTES, *SENSES, "warehouse_env.simulation.traffic")
TASKS = (*RULES, "warehouse_env.simulation.tasks")
BELOW_TRAIN = ("warehouse_env", "agents")

# The first matching prefix of a module lists our own modules that it may import.
MAY_IMPORT: dict[str, tuple[str, ...]] = {
    "warehouse_env.errors": (),
    "warehouse_env.checked": ("warehouse_env.errors",),
    "warehouse_env.portable": (),
    "warehouse_env.start": ("train.cli",),  # the door of the command
    "warehouse_env.compiled": (),
    "warehouse_env.heap": ("warehouse_env.kernel",),
    "warehouse_env.linked": (),
    "warehouse_env.kernel": ("warehouse_env.compiled", "warehouse_env.linked"),
    "warehouse_env.files": ("warehouse_env.errors",),
    "warehouse_env.threads": ("warehouse_env.errors",),
    "warehouse_env.work": ("warehouse_env.errors", "warehouse_env.checked"),
    "warehouse_env.plugins": ("warehouse_env.errors", "warehouse_env.checked", "warehouse_env.files"),
    "warehouse_env.config": BASE,
    "warehouse_env.observation": BASE,
    "warehouse_env.maps": (*BASE, "warehouse_env.maps"),
    "warehouse_env.planning": PLANNING,
    "warehouse_env.routes": ROUTES,
    **dict.fromkeys(DOOR, BASE),
    "warehouse_env.simulation.physics": PHYSICS,
    "warehouse_env.simulation.driver": DRIVER,
    "warehouse_env.simulation.senses": SENSES,
    "warehouse_env.simulation.traffic": RULES,
    "warehouse_env.simulation.tasks": TASKS,
    "warehouse_env.simulation.device": (*SIMULATION, "warehouse_env.compiled"),
    "warehouse_env.simulation": SIMULATION,
    "warehouse_env.render": (*BASE, "warehouse_env.maps", "warehouse_env.simulation.state", "warehouse_env.render"),
    "warehouse_env.envs": (*SIMULATION, "warehouse_env.envs", "warehouse_env.render"),
    "warehouse_env.torchrl": (*SIMULATION, "warehouse_env.envs"),
    "warehouse_env.benchmarl": (*SIMULATION, "warehouse_env.torchrl", "warehouse_env.benchmarl"),
    "warehouse_env": ("warehouse_env",),
    "agents": (*PLANNING, "warehouse_env.observation", "agents"),
    "train.reporting": ("warehouse_env", "train.reporting"),
    "train.books": BELOW_TRAIN,
    "train.epibt": (*BELOW_TRAIN, "train.epibt"),
    "train.execute": (*BELOW_TRAIN, "train.execute"),
    "train.job_files": (*BELOW_TRAIN, "train.execute.lifelong"),
    "train.kinds": BELOW_TRAIN,
    "train.learning": (
        *BELOW_TRAIN,
        "train.books",
        "train.kinds",
        "train.job_files",
        "train.reporting",
        "train.learning",
    ),
    "train.central": (*BELOW_TRAIN, "train.central"),
    # the audit uses none of the engine's geometry and motion
    **dict.fromkeys(
        (f"train.evaluation.audit.{module}" for module in ("bodies", "arcs", "instants")),
        (*BASE, "warehouse_env.simulation.state", "train.evaluation.audit"),
    ),
    "train.evaluation": (
        *BELOW_TRAIN,
        "train.books",
        "train.epibt",
        "train.execute",
        "train.job_files",
        "train.reporting",
        "train.evaluation",
    ),
    "train.tables": (*BELOW_TRAIN, "train.reporting", "train.evaluation", "train.tables"),
    "train": (*BELOW_TRAIN, "train"),
}  # fmt: skip

# Packages that only these modules may import.
ONLY_IN: dict[str, tuple[str, ...]] = {
    "torch": (
        "agents.networks",
        "agents.sb3_model",
        "train",
        "warehouse_env.envs.tensors",
        "warehouse_env.simulation.device",
        "warehouse_env.torchrl",
    ),
    "torchrl": ("warehouse_env.torchrl", "warehouse_env.benchmarl"),
    "tensordict": ("warehouse_env.torchrl",),
    **dict.fromkeys(("benchmarl", "hydra", "omegaconf"), ("warehouse_env.benchmarl",)),
    "stable_baselines3": (
        "warehouse_env.envs.vector", "warehouse_env.envs.callback", "agents.sb3_model", "train.ppo",
    ),
    "ray": ("train.evaluation.cluster",),
    "pygame": ("warehouse_env.render", "train.reporting.report"),
    "matplotlib": ("warehouse_env.render", "train.reporting.report"),
    "imageio": ("warehouse_env.render", "train.reporting.report"),
    "imageio_ffmpeg": ("warehouse_env.render", "train.reporting.report"),
}  # fmt: skip

# Optional packages and our render package: imported inside functions, never at module load.
LAZY = ("pygame", "matplotlib", "imageio", "imageio_ffmpeg", "ray")
LAZY_IN_ENVS = ("warehouse_env.render",)


class Import(NamedTuple):
    """One import: module, target, line, and whether it runs at module load."""

    module: str
    target: str
    line: int
    at_load: bool


def within(module: str, prefixes: tuple[str, ...]) -> bool:
    return any(module == prefix or module.startswith(f"{prefix}.") for prefix in prefixes)


def module_name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports_of(module: str, source: str) -> Iterator[Import]:
    """Yield every import of a module's source, including `importlib.import_module("...")` and similar calls."""
    todo: list[tuple[ast.AST, bool]] = [(ast.parse(source), True)]
    while todo:
        node, at_load = todo.pop()
        for target in _targets(node):
            yield Import(module, target, getattr(node, "lineno", 0), at_load)
        inside = isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
        typing_only = isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
        todo += [(child, at_load and not inside and not typing_only) for child in ast.iter_child_nodes(node)]


def _targets(node: ast.AST) -> list[str]:
    """Return the modules that a node imports; names of the package itself count as their home module."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if isinstance(node, ast.ImportFrom):
        assert node.level == 0, f"relative import on line {node.lineno}: name the whole module"
        homes = warehouse_env._HOME if node.module == "warehouse_env" else {}
        whole = node.module in PACKAGES
        return [
            f"{node.module}.{homes.get(alias.name, alias.name)}" if whole else str(node.module) for alias in node.names
        ]
    if isinstance(node, ast.Call) and node.args and isinstance(node.args[0], ast.Constant):
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        if name in ("import_module", "__import__", "load") and isinstance(node.args[0].value, str):
            return [node.args[0].value]
    return []


def faults(found: Iterator[Import]) -> list[str]:
    """Return one sentence for each forbidden import."""
    sentences = []
    for module, target, line, at_load in found:
        where = f"{module} line {line} imports {target}"
        rule = next(prefix for prefix in MAY_IMPORT if within(module, (prefix,)))
        if target.split(".")[0] in PACKAGES and not within(target, MAY_IMPORT[rule]):
            sentences.append(f"{where}, but {rule} may import only {', '.join(MAY_IMPORT[rule]) or 'none of ours'}")
        for package, homes in ONLY_IN.items():
            if within(target, (package,)) and not within(module, homes):
                sentences.append(f"{where}, which only {', '.join(homes)} may")
        lazy = LAZY + (LAZY_IN_ENVS if rule == "warehouse_env.envs" else ())
        if at_load and within(target, lazy):
            sentences.append(f"{where} when loaded; import it inside the function that uses it")
    return sentences


def cycles(imports: dict[str, set[str]]) -> list[str]:
    """Return the modules in import cycles and their importers: the rest after removing leaves."""
    rest = dict(imports)
    while leaves := [module for module, targets in rest.items() if not targets & rest.keys()]:
        for module in leaves:
            del rest[module]
    return sorted(rest)


def test_modules_have_no_import_cycles() -> None:
    sources = {module_name(path): path for package in PACKAGES for path in (ROOT / package).rglob("*.py")}
    imports: dict[str, set[str]] = {module: set() for module in sources}
    for module, path in sources.items():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = {alias.name for alias in node.names} if isinstance(node, ast.ImportFrom) else set()
            inner = {f"{node.module}.{name}" for name in names if isinstance(node, ast.ImportFrom)} & sources.keys()
            imports[module] |= (inner or set(_targets(node))) - {module}
    assert not cycles(imports)
    assert cycles({"a": {"b", "c"}, "b": {"c"}, "c": {"a", "math"}, "d": {"a"}, "e": {"math"}}) == ["a", "b", "c", "d"]


def test_every_import_is_allowed() -> None:
    found = [
        fault
        for package in PACKAGES
        for path in sorted((ROOT / package).rglob("*.py"))
        for fault in faults(imports_of(module_name(path), path.read_text(encoding="utf-8")))
    ]
    assert not found, "\n" + "\n".join(found)


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("warehouse_env.maps.grid_map", "from warehouse_env.planning import PLANNERS"),
        ("warehouse_env.planning.ants.aco", "import warehouse_env.simulation.step"),
        ("warehouse_env.planning.ants.aco", "from warehouse_env import Simulator"),
        ("warehouse_env.simulation.driver.tracking", "from warehouse_env.simulation.traffic import shield"),
        ("warehouse_env.simulation.step", "def f():\n    import torch"),
        ("warehouse_env.envs.parallel", "from warehouse_env.render.frame import draw"),
        ("warehouse_env.envs.parallel", "import stable_baselines3"),
        ("warehouse_env.envs.tensors", "from warehouse_env.torchrl import torchrl_env"),
        ("warehouse_env.envs.tensors", "import torchrl.envs"),
        ("warehouse_env.render.frame", "import pygame"),
        ("agents.brake", "from train.advice.trips import traffic"),
        ("agents.brake", "import importlib\nt = importlib.import_module('torch')"),
        ("train.reporting.report", "import matplotlib.pyplot as plt"),
        ("train.central.search", "from train.evaluation.rollout import run"),
    ],
)
def test_import_rules_catch_violations(module: str, source: str) -> None:
    assert faults(imports_of(module, source))


def test_no_threads_of_numba_or_a_blas_are_started() -> None:
    """Threads of Numba's parallel regions and of a BLAS occupy cores while they wait for work."""
    every_step = ("warehouse_env.simulation", "warehouse_env.envs", "agents")
    for path in (path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            where = f"{path} line {getattr(node, 'lineno', 0)}"
            assert not (isinstance(node, ast.keyword) and node.arg == "parallel"), f"{where}: a parallel region"
            number = isinstance(node, ast.Attribute) and node.attr in ("set_num_threads", "get_num_threads")
            assert not (number and ast.unparse(node).startswith("numba.")), f"{where}: this starts Numba's threads"
            product = isinstance(node, ast.BinOp) and isinstance(node.op, ast.MatMult)
            assert not (product and within(module_name(path), every_step)), f"{where}: a product for the BLAS"


IMPORT_TIME = """
import time
begun = time.process_time()
import warehouse_env
taken = time.process_time() - begun
import sys
heavy = {"torch", "stable_baselines3", "numba", "pettingzoo", "matplotlib", "pygame", "scipy"} & set(sys.modules)
assert not heavy, heavy
print(taken)
"""


def test_importing_the_package_is_light() -> None:
    """Take the least processor time of three, so that a loaded machine does not fail the test."""

    def once() -> float:
        run = subprocess.run([sys.executable, "-c", IMPORT_TIME], cwd=ROOT, capture_output=True, text=True, check=False)
        assert run.returncode == 0, run.stderr
        return float(run.stdout)

    assert min(once() for _ in range(3)) < 0.5


def test_every_public_name_exists() -> None:
    assert set(warehouse_env.__all__) == {*warehouse_env._HOME, "__version__"}
    for name in warehouse_env.__all__:
        assert getattr(warehouse_env, name) is not None
        assert name in dir(warehouse_env)
    with pytest.raises(AttributeError, match="no_such_name"):
        _ = warehouse_env.no_such_name
