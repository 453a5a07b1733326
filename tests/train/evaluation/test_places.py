"""Where robots wait and touch: what a drive notes agrees with its row; sums and worst places by hand."""

from __future__ import annotations

import numpy as np
import pytest

from train.evaluation.places import PlaceNotes, floor_of_notes, peaks
from train.evaluation.rollout import make_experiment, run
from warehouse_env.config import EnvConfig


def test_notes_agree_with_the_rows() -> None:
    base = EnvConfig(layout="narrow", num_agents=12, planner="astar")
    experiment = make_experiment("follow", base, 2, 60.0, seed=400)
    places = PlaceNotes(experiment)
    rows, notes = run(experiment, [places]), places.rows()
    assert sum(row["collisions_robot"] for row in rows) > 0
    for row, note in zip(rows, notes, strict=True):
        assert [row[name] for name in ("policy", "layout", "robots", "seed")] == [
            note[name] for name in ("policy", "layout", "robots", "seed")
        ]
        assert note["seconds"] == pytest.approx(60.0)
        waited = sum(seconds for _, seconds in note["waited"])
        assert waited == pytest.approx(row["waiting_share"] * 12 * 60.0, abs=0.01 * len(note["waited"]))
        assert sum(kind == "shelf" for *_, kind in note["contacts"]) == row["collisions_shelf"]
        # Contacts of three robots in one step may share a middle.
        assert 0 <= row["collisions_robot"] - sum(kind == "robot" for *_, kind in note["contacts"]) <= 1


def test_the_floor_of_two_notes_by_hand() -> None:
    one = {"shape": [2, 3], "seconds": 1800.0, "waited": [[0, 10.0], [5, 2.0]], "contacts": [[1.0, 2.0, "robot"]]}
    two = {"shape": [2, 3], "seconds": 1800.0, "waited": [[5, 4.0]], "contacts": []}
    floor = floor_of_notes([one, two])
    assert floor.hours == 1.0
    assert floor.waiting.tolist() == [[10.0, 0.0, 0.0], [0.0, 0.0, 6.0]]
    assert floor.contacts.tolist() == [[1.0, 2.0]]


def test_peaks_are_the_hottest_squares_apart() -> None:
    heat = np.zeros((7, 9))
    heat[1, 1], heat[1, 2] = 5.0, 4.0  # 9 together; the square around either holds both, and (1, 1) is hotter
    heat[5, 7] = 7.0
    heat[3, 5] = 1.0
    assert peaks(heat, 9, radius=1) == [(1, 1, 9.0), (5, 7, 7.0), (3, 5, 1.0)]
    assert peaks(heat, 1, radius=1) == [(1, 1, 9.0)]
    assert peaks(np.zeros((3, 3)), 3, radius=1) == []
    assert heat.sum() == 17.0  # left as it was
