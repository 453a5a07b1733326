"""Safe YAML, read in time and memory proportional to the file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from warehouse_env.errors import MapError, shown
from warehouse_env.files import read_text

_DEEPEST = 16  # mappings and lists within each other


class _Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """A safe loader, in C if available, that refuses duplicate names."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Return the entries of a mapping."""
        names = [(key.tag, key.value) for key, _ in node.value if isinstance(key, yaml.ScalarNode)]
        if len(set(names)) < len(names):
            raise yaml.constructor.ConstructorError(None, None, "a name is given twice", node.start_mark)
        made: dict[Any, Any] = super().construct_mapping(node, deep)
        return made


def read_yaml(path: Path, kind: str, most: int) -> Any:
    """Return the content of a file of at most `most` bytes; MapError, naming the `kind` of file.

    Aliases, which can make a short file endless, and more than 16 levels are refused.
    """
    text = read_text(path, kind, most)
    try:
        _check(text, path)
        return yaml.load(text, _Loader)
    except MapError:  # a ValueError as well
        raise
    except yaml.MarkedYAMLError as error:
        line = f", line {error.problem_mark.line + 1}" if error.problem_mark else ""
        raise MapError(f"{path}{line} is no YAML: {shown(error.problem)[1:-1]}") from None
    except (yaml.YAMLError, ValueError, TypeError, RecursionError, OverflowError) as error:
        raise MapError(f"{path} is no YAML: {shown(str(error))[1:-1]}") from None


def _check(text: str, path: Path) -> None:
    depth = 0
    for event in yaml.parse(text, _Loader):
        if isinstance(event, yaml.AliasEvent):
            raise MapError(f"{path} has an alias (*name), which it does not need; write the value itself")
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > _DEEPEST:
            raise MapError(f"{path}, line {event.start_mark.line + 1} is deeper than {_DEEPEST} levels")
