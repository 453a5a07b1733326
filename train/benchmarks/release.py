"""Compare ratios of the step with those of the last release, and name the commit and day of new ones."""

from __future__ import annotations

import datetime
import subprocess
from collections.abc import Sequence
from pathlib import Path

from train.reporting.rows import Row, read_rows, select, write_rows
from warehouse_env import __version__
from warehouse_env.errors import WarehouseError

ROOT = Path(__file__).parents[2]
RELEASE = Path(__file__).parent / "release.jsonl"
RENEW = "warehouse bench --only reference --write-release"
_LEFT = 2 / 3  # of a release's ratio: losing a third is more than machines and minutes differ by
_NAMES = ("run", "envs", "agents", "reference")


def write_release(rows: Sequence[Row], path: Path = RELEASE) -> None:
    """Keep the rows of `reference` as those of the release."""
    write_rows(path, select(rows, what="reference"))


def judge(rows: Sequence[Row], path: Path = RELEASE) -> None:
    """Raise WarehouseError if a ratio of `reference` is a third below the release's, or the release has none."""
    ratios, written = select(rows, what="reference"), read_rows(path)
    unknown = [_name(row) for row in ratios if not _same(written, row)]
    if unknown:
        raise WarehouseError(f"{path.name} has no ratio for {'; '.join(unknown)}: write all down with `{RENEW}`")
    fell = [
        f"{_name(row)} fell from {one['ratio']:.3g} of the speed of {row['reference']} to {row['ratio']:.3g}"
        for row in ratios
        for one in _same(written, row)
        if row["ratio"] <= _LEFT * one["ratio"]
    ]
    if fell:
        raise WarehouseError(
            f"the step has lost a third of its speed or more since {written[0]['commit']} ({written[0]['date']}): "
            f"{'; '.join(fell)}. Measure again on a quiet machine; then find the commit that costs it and make it "
            f"cheaper, or, where it is worth its price, say so in the commit and write down new ratios with `{RENEW}`"
        )


def _same(written: Sequence[Row], row: Row) -> list[Row]:
    return select(written, **{name: row[name] for name in _NAMES})


def _name(row: Row) -> str:
    return f"{row['run']} at {row['envs']} x {row['agents']}"


def origin() -> Row:
    """Return the commit of the source, or the package's version without git, and today's date."""
    return {"commit": commit(ROOT) or __version__, "date": datetime.date.today().isoformat()}


def commit(root: Path) -> str | None:
    """Return the commit of a working copy, with "-dirty" where files differ; None without git."""
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
