"""The entry point of the command `warehouse`, which first checks that no other package hides ours."""

import importlib
import importlib.util
import sys
from importlib.metadata import distribution, packages_distributions
from pathlib import Path

_OURS, _ROOT = "warehouse-env", Path(__file__).parent.parent


def stranger(name: str) -> str | None:
    """Return a sentence if Python finds a package other than ours as `agents` or `train`; else None."""
    spec = importlib.util.find_spec(name)
    found = Path(spec.origin) if spec and spec.origin else _ROOT / name
    if found == _ROOT / name / "__init__.py" and "warehouse_env" in found.read_text(encoding="utf-8"):
        return None
    place = found.parent if found.name == "__init__.py" else found
    others = [one for one in packages_distributions().get(name, ()) if one.replace("_", "-") != _OURS]
    owners = [one for one in others if Path(str(distribution(one).locate_file(name))) == place]
    said = f"Python finds {place} as {name}, which hides the package {name} of {_OURS}"
    if owners:
        return f"{said}; it is of {owners[0]}: install the two in environments of their own"
    return f"{said}: rename it, or start in another folder"


def main() -> int:
    """Run the command line; returns the exit code: 2, with one sentence, where a package of ours is hidden."""
    for name in ("agents", "train"):
        if said := stranger(name):
            print(f"warehouse: {said}", file=sys.stderr)
            return 2
    return int(importlib.import_module("train.cli").main())
