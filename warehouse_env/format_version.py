"""Versions of files and messages as other programs write them."""

import re

_VERSION = re.compile(r"\s*v?(\d{1,3})(\.\d{1,9}){0,3}([-+]\S*)?\s*", re.ASCII | re.IGNORECASE)


def major_of(version: object) -> int | None:
    """Return the major number of a version such as "2.1.0", "v2" or 2.1; None for anything else."""
    written = isinstance(version, str | int | float) and not isinstance(version, bool)
    found = _VERSION.fullmatch(str(version)[:100]) if written else None
    return int(found[1]) if found else None
