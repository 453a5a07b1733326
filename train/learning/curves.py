"""Learning curves of finished and running trainings, read from their folders."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from agents.weights_folder import CONFIG, read_record
from train.learning.progress import ROWS
from train.reporting.rows import Row, read_rows
from warehouse_env.errors import WeightsError
from warehouse_env.render.learning_curves import PANELS, Curve

KEYS = tuple(key for key, _, _ in PANELS)


class CurveRun(NamedTuple):
    """A training: its folder, its seed if that is known, and its curve."""

    folder: Path
    seed: int | None
    curve: Curve

    def rows(self) -> list[Row]:
        """Return what is drawn, a row for each point."""
        about = {"run": self.folder.name, "algorithm": self.curve.algorithm, "seed": self.seed}
        columns = [self.curve.steps, *(self.curve.values[key] for key in KEYS)]
        return [about | dict(zip(("steps", *KEYS), point, strict=True)) for point in zip(*columns, strict=True)]


def read_run(folder: Path) -> CurveRun:
    """Return the training in a folder; WarehouseError in one sentence if there is none, or it has no rows yet."""
    for name in (CONFIG, ROWS):
        if not (folder / name).is_file():
            raise WeightsError(f"{folder} is no run of training: it has no {name}")
    record, path = read_record(folder), folder / ROWS
    rows = read_rows(path)
    try:
        steps = np.array([row["steps"] for row in rows], dtype=np.float64)
        values = {key: np.array([row.get(key) for row in rows], dtype=np.float64) for key in KEYS}  # None becomes nan
    except (KeyError, TypeError, ValueError):
        raise WeightsError(f"{path} holds rows that are none of a training") from None
    if not len(steps) or not (np.diff(steps) > 0).all():
        raise WeightsError(f"{path} holds no rows whose steps grow")
    config = record.training.get("config")
    seed = config.get("seed") if isinstance(config, dict) else None
    return CurveRun(folder, seed, Curve(record.algorithm, steps, values))
