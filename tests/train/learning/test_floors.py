"""Floors of a training: drawn ones change, follow from the seed and leave nothing behind; plans made ahead."""

from __future__ import annotations

import weakref
from functools import partial
from pathlib import Path

import pytest
import torch

from tests.train.trainings import SMALL
from train import books
from train.learning.config import ThreadedPPOConfig, TrainingConfig
from train.learning.plan_ahead import plan_ahead
from train.learning.worlds import TrainingSimulator, TrainingWorlds


def _worlds(seed: int = 3) -> TrainingWorlds:
    """Return worlds on one fixed floor and on two drawn ones, each of these for two episodes of 15 steps."""
    layouts = ("open", "aisles:seed=new,rows=24")
    mixes = ThreadedPPOConfig(**SMALL | {"layouts": layouts, "robots": (16,), "traffic": "none"}).worlds(256)
    return TrainingWorlds(partial(TrainingSimulator, jam_seconds=60.0, shared=0.0), mixes, [seed, 0], 2)


def _floors(worlds: TrainingWorlds) -> list[str]:
    return [simulator.config.layout for simulator in worlds.simulators]


def _drive(worlds: TrainingWorlds, steps: int) -> list[list[int]]:
    """Return the rows whose episodes ended with each step."""
    onwards = torch.full((worlds.rows,), int(worlds.simulators[0].cruise_action))
    return [[row for rows, _ in worlds.step(onwards) for row in rows.tolist()] for _ in range(steps)]


def test_floors_change_in_turn_and_leave_nothing_behind() -> None:
    worlds = _worlds()
    seen, kept = [_floors(worlds)], books._books.copy()
    book, fixed = weakref.ref(worlds.simulators[1].route_book), worlds.simulators[0]
    for _ in range(4):
        last = _drive(worlds, 15)[-1]
        seen.append(_floors(worlds))
        changed = [number for number in (1, 2) if seen[-1][number] != seen[-2][number]]
        assert changed == [2 - len(seen) % 2]  # the second after 15 and 45 steps, the first after 30 and 60
        first = 64 * (1 + changed[0])
        assert set(range(first, first + 64)) <= set(last)  # all its episodes end
    drawn = {layout for floors in seen for layout in floors[1:]}
    assert len(drawn) == 6
    assert all(1_000_000 <= int(layout.split("=")[1].split(",")[0]) < 900_000_000 for layout in drawn)
    assert all(simulator.grid.shape[0] == 24 for simulator in worlds.simulators[1:])
    assert drawn.isdisjoint(_floors(_worlds(seed=4)))
    assert worlds.simulators[0] is fixed
    assert book() is None
    assert books._books == kept


@pytest.mark.parametrize("steps", [0, 5, 15, 20, 47])
def test_worlds_are_brought_back_on_their_floors(steps: int) -> None:
    """Worlds that replay a history go on as those that it is of; so do worlds of the same seed after no step."""
    worlds, twin = _worlds(), _worlds()
    _drive(worlds, steps)
    twin.replay(worlds.history())
    for _ in range(33):
        assert _floors(twin) == _floors(worlds)
        for mine, its in zip(worlds.simulators, twin.simulators, strict=True):
            assert mine.robots.tobytes() == its.robots.tobytes()
        assert torch.equal(worlds.observation, twin.observation)
        assert _drive(worlds, 1) == _drive(twin, 1)


@pytest.mark.parametrize(("steps", "traffic"), [(10**9, "none"), (1000, "none"), (10**9, "routes")])
def test_a_training_makes_the_plan_table_of_a_floor_where_it_pays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, steps: int, traffic: str
) -> None:
    monkeypatch.setenv("WAREHOUSE_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(books, "_books", {})
    floor = tmp_path / "small.map"
    floor.write_text("type octile\nheight 3\nwidth 4\nmap\n....\n.@@.\n....\n")
    config = TrainingConfig(layouts=(str(floor),), robots=(1, 2), steps=steps, traffic=traffic, planner="pf_aco")
    plan_ahead(config)
    pays = steps > 1000 and traffic == "none"  # live routes of pf_aco need no plans
    assert books.book_of(config.env(str(floor), 1)).has_table == pays
    assert len(list(tmp_path.glob("plans-*.npz"))) == pays
