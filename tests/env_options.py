"""Write warehouse_env/env_options.py, the types that editors and mypy read, from EnvConfig."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

from warehouse_env import config
from warehouse_env.config import EnvConfig

PATH = Path(__file__).parents[1] / "warehouse_env" / "env_options.py"
_HEAD = '''"""Option types for editors and mypy: `python -m tests.env_options` writes them from EnvConfig."""

from __future__ import annotations

from typing import TypedDict

{imports}


class EnvOptions(TypedDict, total=False):
    """Fields of EnvConfig as the env functions take them by name; `planner` may be an object there."""

{fields}


class ConfigChanges(EnvOptions, total=False):
    """Every field of EnvConfig."""

    planner: str
'''


def text() -> str:
    """Return the file's content."""
    fields = {one.name: str(one.type) for one in dataclasses.fields(EnvConfig) if one.name != "planner"}
    names = set(re.findall(r"[A-Z]\w+", " ".join(fields.values()))) - {"None"}
    homes: dict[str, list[str]] = {}
    for name in sorted(names):
        home = getattr(config, name).__module__
        homes.setdefault(config.__name__ if home == "typing" else home, []).append(name)  # aliases are config's own
    imports = (_import(home, sorted(names)) for home, names in sorted(homes.items()))
    lines = (f"    {name}: {kind}" for name, kind in fields.items())
    return _HEAD.format(imports="\n".join(imports), fields="\n".join(lines))


def _import(home: str, names: list[str]) -> str:
    """Return an import as ruff has it."""
    line = f"from {home} import {', '.join(names)}"
    return line if len(line) <= 120 else f"from {home} import (\n" + "".join(f"    {name},\n" for name in names) + ")"


if __name__ == "__main__":
    PATH.write_text(text(), encoding="utf-8")
