"""Test changes and trips: noise is no gain, real gains are found, lost storage counts; traffic by hand."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.train.advice.floors import RACKS, driver, floor_of, plan_of
from train.advice.changes import PAIRS, Candidate, Effect, affordable, measured, storage_lost
from train.advice.study import Team, TrialRuns
from train.advice.trials import AS_IS, BLOCK, TimeBudget, Trial, Use
from train.advice.trips import Bottleneck, bottlenecks, draw_trips, plan_trips, traffic
from warehouse_env.maps.layouts import make_layout

HALL = floor_of(*["............"] * 10)
TEAM = Team("ours", 20)
NOTHING = np.zeros(HALL.shape, dtype=np.bool_)
AISLES = [Candidate(f"aisle {k}", HALL, NOTHING) for k in range(6)]


def effect_of(study: TrialRuns, chosen: Sequence[Candidate]) -> Effect:
    found = measured(study, chosen, TEAM)
    assert found is not None
    return found


def best_effect(salt: int, pairs: int = PAIRS, **changed: float) -> Effect:
    """Return the effect of the best of six changes in 3% noise; changed: gains by name, with _ for a space."""
    gains = {name.replace("_", " "): gain for name, gain in changed.items()}
    drive = driver({"ours": lambda robots: 4000.0}, 0.03, changed=gains, salt=salt)
    return effect_of(TrialRuns(plan_of(HALL, episodes=pairs), drive, TimeBudget(None)), AISLES)


def test_noise_is_a_gain_on_at_most_one_floor_in_twenty() -> None:
    floors = [best_effect(salt) for salt in range(60)]
    assert all(effect.tried == 6 for effect in floors)
    assert sum(effect.significant for effect in floors) <= 7  # 98% bound for 60 floors at 5%


@pytest.mark.parametrize("salt", range(3))
def test_useful_change_is_found_among_useless_ones(salt: int) -> None:
    best = best_effect(salt, 12, aisle_3=400.0, aisle_1=-400.0)
    assert best.candidate.text == "aisle 3"
    assert best.significant
    assert best.gain.mean == pytest.approx(400.0, abs=150.0)


def test_gain_is_measured_on_fresh_seeds() -> None:
    def drive(trials: Sequence[Trial]) -> list[dict[str, Any]]:
        """Double the goals of changed floors on seeds of the race."""
        rows = driver({"ours": lambda robots: 4000.0})(trials)
        for row, trial in zip(rows, trials, strict=True):
            lucky = trial.floor != AS_IS and row["seed"] in plan_of(HALL).seeds(Use.LOOK, BLOCK)
            row["goals_per_robot_hour"] *= 2 if lucky else 1
        return rows

    assert effect_of(TrialRuns(plan_of(HALL, episodes=12), drive, TimeBudget(None)), AISLES).gain.mean == 0


def test_few_pairs_are_not_significant() -> None:
    best = best_effect(0, PAIRS - 1, aisle_3=4000.0)
    assert best.gain.low > 0
    assert not best.significant


def test_time_limits_the_number_of_changes() -> None:
    assert affordable(math.inf, 1.0) == 6
    assert affordable((3 * (1 + 2) + 2 * PAIRS) * 10.0, 10.0) == 2  # two changes and the present floor, then the pairs
    assert affordable(2 * PAIRS * 10.0, 10.0) == 1
    assert affordable((2 * PAIRS - 1) * 10.0, 10.0) == 0


def test_aisle_states_the_lost_storage() -> None:
    """Open one of two rows of a rack of eight cells that twelve cells surround; the wall is no storage."""
    hall = floor_of("######", "......", ".####.", ".####.", "......")
    opened = np.zeros(hall.shape, dtype=np.bool_)
    opened[2, 1:5] = True
    cells, share, faces, served = storage_lost(hall, Candidate("", hall, opened))
    assert (cells, share) == (4, 0.5)
    picks = {tuple(cell) for cell in hall.picks.tolist()}
    north = picks & {(1, column) for column in range(1, 5)}
    ends = picks & {(2, 0), (2, 5)}
    assert (faces, served) == (len(north) + len(ends), len(picks))
    assert faces > 0


def test_single_change_needs_no_race() -> None:
    driven: list[str] = []

    def drive(trials: Sequence[Trial]) -> list[dict[str, Any]]:
        driven.extend(trial.floor for trial in trials)
        return driver({"ours": lambda robots: 4000.0})(trials)

    study = TrialRuns(plan_of(HALL), drive, TimeBudget(None))
    assert effect_of(study, AISLES[:1]).tried == 1
    assert all(driven.count(floor) == 6 for floor in ("as it is", "aisle 0"))
    assert measured(study, [], TEAM) is None


def test_trips_alternate_between_picks_and_stations() -> None:
    grid = make_layout("single_lane")
    picks, stations = ({tuple(cell) for cell in cells.tolist()} for cells in (grid.picks, grid.stations))
    trips = draw_trips(grid, 1, 50)
    assert len(trips) == 50
    for number, (start, goal) in enumerate(trips):
        assert (start in picks and goal in stations) if number % 2 else (start in stations and goal in picks)
    assert len({start for start, _ in trips[1::2]}) == 25  # picks repeat only after all were used
    assert trips == draw_trips(grid, 1, 50)


def test_traffic_of_two_routes_by_hand() -> None:
    visits, _ = traffic([np.array([(0, 0), (0, 1), (1, 2)]), np.array([(0, 1), (0, 0)])], (2, 3))
    assert visits.tolist() == [[1.0, 1.0, 0.0], [0.0, 0.0, 0.5]]


def test_bottlenecks_state_place_in_metres_and_share() -> None:
    waiting = np.zeros((7, 6))
    waiting[3, 3], waiting[6, 0] = 30.0, 10.0
    visits = np.zeros((7, 6))
    visits[3, 4] = 0.25
    first, second = bottlenecks(RACKS, waiting, visits)
    assert first == Bottleneck((3, 3), 3.5, 3.5, 30.0, 0.75, 0.25)
    assert second[:4] == ((6, 0), 0.5, 0.5, 10.0)


EAST = np.array([(3, column) for column in range(7)])
SOUTH = np.array([(row, 3) for row in range(7)])
JOINING = np.array([(1, 1), (2, 1), *EAST[2:].tolist()])
SLOPE = np.array([(k, k) for k in range(4)])
DIAGONALS = [np.array([(0, 0), (1, 1)]), np.array([(0, 1), (1, 0)])]


@pytest.mark.parametrize(
    ("routes", "met"),
    [
        ([EAST, SOUTH], 2 / 6),  # a window of 1; both routes take 6
        ([EAST, EAST[::-1]], 7 * 2 / 6),  # the opposing stretch is 6 long
        ([SLOPE, SLOPE[::-1]], 2 * (1 + 3 * math.sqrt(2)) / (3 * math.sqrt(2))),
        ([EAST, EAST], 2 / 6),  # one behind the other
        ([EAST, JOINING], 1 / 6 + 1 / (5 + math.sqrt(2))),
        (DIAGONALS, 2 / math.sqrt(2)),  # they cross without a shared cell
        ([DIAGONALS[0][::-1], DIAGONALS[1]], 2 / math.sqrt(2)),
        ([EAST, SOUTH, EAST[::-1]], 2 * 2 / 6 + 7 * 2 / 6),
        ([EAST], 0.0),
    ],
)
def test_conflicts_by_hand(routes: list[np.ndarray], met: float) -> None:
    assert traffic(routes, (7, 7))[1] == pytest.approx(met)


@settings(max_examples=30, deadline=None)
@given(st.lists(st.integers(0, 299), min_size=3, max_size=6, unique=True))
def test_conflicts_sum_over_pairs_in_any_order(chosen: list[int]) -> None:
    grid = make_layout("paper46")
    all_trips = draw_trips(grid, 0)
    routes = plan_trips(grid, [all_trips[k] for k in chosen])
    pairs = sum(traffic([routes[i], routes[j]], grid.shape)[1] for i in range(len(routes)) for j in range(i))
    assert traffic(routes, grid.shape)[1] == pytest.approx(pairs)
    assert traffic(routes[::-1], grid.shape)[1] == pytest.approx(pairs)
