"""Test the pins, the wheel's contents, the version, and the errors of a failed set-up."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from importlib.metadata import packages_distributions, requires
from pathlib import Path

import pytest
from packaging.markers import Marker
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import warehouse_env

ROOT = Path(__file__).parent.parent
PACKAGES = ("warehouse_env", "agents", "train")
CUDA = re.compile(r"(nvidia|cuda|triton)")

# The extras of constraints.txt; clients have their own file.
EXTRAS = ("render", "train", "orca", "onnx", "ray", "fleet", "docs", "dev")

settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
project = settings["project"]
needs_make = pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")


def pins(file: str = "constraints.txt") -> dict[str, str]:
    lines = (ROOT / file).read_text(encoding="utf-8").splitlines()
    pairs = [line.split("==") for line in lines if not line.startswith("#")]
    assert all(len(pair) == 2 for pair in pairs), "each line is one NAME==VERSION"
    names = [canonicalize_name(name) for name, _ in pairs]
    assert len(set(names)) == len(names), "a package is pinned twice"
    return dict(zip(names, (version for _, version in pairs), strict=True))


def installed_closure() -> set[str]:
    """Return all packages that the project and EXTRAS need on this machine, recursively."""
    todo = [Requirement(text) for text in project["dependencies"]]
    todo += [Requirement(text) for extra in EXTRAS for text in project["optional-dependencies"][extra]]
    found: set[tuple[str, str]] = set()
    while todo:
        requirement = todo.pop()
        for extra in ("", *sorted(requirement.extras)):
            key = (canonicalize_name(requirement.name), extra)
            if key not in found and not CUDA.match(key[0]):
                found.add(key)
                needs = [Requirement(text) for text in requires(key[0]) or []]
                todo += [need for need in needs if _applies(need.marker, extra)]
    return {name for name, _ in found}


def _applies(marker: Marker | None, extra: str) -> bool:
    return marker is None or marker.evaluate({"extra": extra})


def data_files() -> set[str]:
    """Return paths of all visible files in the packages that are neither code nor compiled code."""
    files = (path for package in PACKAGES for path in (ROOT / package).rglob("[!.]*"))
    made = (path for path in files if path.is_file() and path.suffix != ".py" and "__pycache__" not in path.parts)
    return {path.relative_to(ROOT).as_posix() for path in made}


def test_pins_are_exactly_the_needed_packages() -> None:
    assert set(pins()) == installed_closure()


def test_pins_meet_the_bounds() -> None:
    extras = project["optional-dependencies"]
    for file, chosen in (("constraints.txt", EXTRAS), ("constraints-clients.txt", (*EXTRAS, "clients"))):
        for text in [*project["dependencies"], *(text for extra in chosen for text in extras[extra])]:
            requirement = Requirement(text)
            assert requirement.specifier.contains(pins(file)[canonicalize_name(requirement.name)]), (file, text)


@pytest.mark.parametrize(("name", "owner"), [("agents", "openai-agents"), ("train", "")])
def test_code_that_shadows_our_packages_is_named(name: str, owner: str, tmp_path: Path) -> None:
    """Cover another package's `agents` and a user's train.py that come before ours on the path."""
    path = tmp_path / (f"{name}/__init__.py" if owner else f"{name}.py")
    path.parent.mkdir(exist_ok=True)
    path.write_text("mine = 'somebody else'\n")
    if owner:
        about = tmp_path / f"{owner.replace('-', '_')}-1.0.dist-info"
        about.mkdir()
        (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {owner}\nVersion: 1.0\n")
        (about / "top_level.txt").write_text(f"{name}\n")
    environment = os.environ | {"PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}"}
    code = "import sys; from warehouse_env.start import main; sys.exit(main())"
    words = [sys.executable, "-P", "-c", code, "--version"]
    run = subprocess.run(words, env=environment, capture_output=True, text=True, check=False)
    (message,) = run.stderr.splitlines()
    assert run.returncode == 2
    assert f"hides the package {name} of warehouse-env" in message
    assert (f"it is of {owner}: install" if owner else "train.py") in message


def test_every_folder_of_code_is_a_package() -> None:
    folders = {path.parent for package in PACKAGES for path in (ROOT / package).rglob("*.py")}
    assert not [folder for folder in folders if not (folder / "__init__.py").is_file()]


def test_data_globs_match_exactly_the_data_files() -> None:
    found: set[str] = set()
    for package, globs in settings["tool"]["setuptools"]["package-data"].items():
        for glob in globs:
            files = {path.relative_to(ROOT).as_posix() for path in (ROOT / package).glob(glob) if path.is_file()}
            assert files, f"{glob} of {package} finds nothing"
            found |= files
    assert found == data_files()


def build(what: str, source: Path, target: Path) -> Path:
    """Build a wheel or sdist of a folder; return its file."""
    script = f"from setuptools import build_meta; print(build_meta.build_{what}({str(target)!r}))"
    run = subprocess.run([sys.executable, "-c", script], cwd=source, check=True, capture_output=True, text=True)
    return target / run.stdout.split()[-1]


@pytest.mark.nightly
def test_wheel_and_sdist_hold_the_packages_and_their_data(tmp_path: Path) -> None:
    source = tmp_path / "source"
    source.mkdir()
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    for name in (*PACKAGES, "tests"):
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
    code = {path.relative_to(ROOT).as_posix() for package in PACKAGES for path in (ROOT / package).rglob("*.py")}
    shutil.unpack_archive(build("sdist", source, tmp_path), tmp_path / "unpacked", "gztar")
    (unpacked,) = (tmp_path / "unpacked").iterdir()
    for folder in (source, unpacked):
        (tmp_path / f"wheel of {folder.name}").mkdir()
        wheel = build("wheel", folder, tmp_path / f"wheel of {folder.name}")
        assert wheel.name.endswith("-py3-none-any.whl"), "nothing to compile"
        names = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
        assert names == code | data_files()


def test_version_is_semantic_and_in_changelog_and_citation() -> None:
    assert re.fullmatch(r"\d+\.\d+\.\d+", project["version"])
    assert project["version"] == warehouse_env.__version__
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    dated = re.findall(r"^## \[(\d+\.\d+\.\d+)\] - (\d{4}-\d\d-\d\d)$", changes, re.MULTILINE)
    assert dated[0][0] == project["version"], "the newest version is this one"
    cited = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {project['version']}\ndate-released: {dated[0][1]}\n" in cited


def make(*words: str, path: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Run make in the project with `path` first on PATH and without an outer make's variables."""
    environment = {name: value for name, value in os.environ.items() if not re.match("MAKE|MFLAGS|VENV$|PYTHON$", name)}
    if path is not None:
        environment["PATH"] = f"{path}{os.pathsep}{environment['PATH']}"
    return subprocess.run(["make", *words], cwd=ROOT, env=environment, capture_output=True, text=True, check=False)


@needs_make
@pytest.mark.parametrize(
    ("script", "sentence"),
    [
        (
            "case $2 in *version_info*) exit 1;; *) echo Python 3.9.2;; esac",
            "Python 3.9.2, but 3.11 or newer is needed",
        ),
        ("case $2 in *ensurepip*) exit 1;; esac", "apt install python3-venv"),
    ],
)
def test_set_up_names_missing_parts(tmp_path: Path, script: str, sentence: str) -> None:
    python = tmp_path / "python3"
    python.write_text(f"#!/bin/sh\n{script}\n", encoding="utf-8")
    python.chmod(0o755)
    run = make("setup", f"VENV={tmp_path / 'new'}", path=tmp_path)
    assert run.returncode != 0
    assert sentence in run.stderr
    assert not (tmp_path / "new").exists()


@needs_make
def test_set_up_keeps_a_foreign_folder(tmp_path: Path) -> None:
    (tmp_path / "letter.txt").write_text("dear", encoding="utf-8")
    run = make("setup", f"VENV={tmp_path}", f"PYTHON={sys.executable}")
    assert run.returncode != 0
    assert "is no virtual environment" in run.stderr
    assert (tmp_path / "letter.txt").exists()


COMPILES = """
import sys
absent = set(sys.argv[1].split())
class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in absent:
            raise ModuleNotFoundError(name)
sys.meta_path.insert(0, Absent())
from train.evaluation.kernels import PARTS
PARTS["one robot's motion"]()
"""


def test_kernels_compile_with_few_packages_installed() -> None:
    """The Makefile compiles kernels with few packages installed; all their imports must be among these."""
    (line,) = re.findall(r"^COMPILING := (.*)$", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    there = {canonicalize_name(name) for name in line.split()}
    needed = {canonicalize_name(Requirement(text).name) for text in project["dependencies"]} - {"numpy"}  # numba's
    modules = packages_distributions()
    absent = [module for module, owners in modules.items() if {canonicalize_name(o) for o in owners} & (needed - there)]
    assert {"torch", "stable_baselines3"} <= set(absent)
    subprocess.run([sys.executable, "-c", COMPILES, " ".join(absent)], cwd=ROOT, check=True)
