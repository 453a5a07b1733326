"""Where a measurement comes from: the commit and the day."""

from __future__ import annotations

import datetime
import subprocess
from pathlib import Path

from train.reporting.rows import Row
from warehouse_env import __version__

ROOT = Path(__file__).parents[2]


def origin() -> Row:
    """Return the commit of the source, or the version of the package where there is no git; and today's date."""
    return {"commit": commit(ROOT) or __version__, "date": datetime.date.today().isoformat()}


def commit(root: Path) -> str | None:
    """Return the commit that a working copy stands on, with "-dirty" where files differ; None if it is none."""
    if not (root / ".git").exists():
        return None
    try:
        done = subprocess.run(
            ["git", "-C", root, "describe", "--always", "--dirty", "--exclude", "*"],
            capture_output=True, text=True, check=True,
        )  # fmt: skip
    except (OSError, subprocess.CalledProcessError):
        return None
    return done.stdout.strip()
