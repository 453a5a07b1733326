"""The benchmark that others can enter: the set is fixed, an entry whole and unchanged, its episodes come again."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from train.cli import main
from train.evaluation.rollout import config_of, run
from train.leaderboard import cases
from train.leaderboard.board import board
from train.leaderboard.cases import CASES, TRACKS, VERSION, Case, experiments, options, set_hash
from train.leaderboard.entry import (
    COLUMNS,
    SHIPPED,
    Entry,
    drive_again,
    faults,
    make_entry,
    read_entry,
    write_entry,
)
from warehouse_env.config import EnvConfig
from warehouse_env.errors import WarehouseError

SMALL = (Case("few", "open", 2, 2), Case("more", "aisles:seed=801", 3, 1))


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let episodes be short, as those of `entry` are."""
    monkeypatch.setattr(cases, "SECONDS", 8.0)


@pytest.fixture(scope="module")
def entry() -> Entry:
    """Drive `follow` through a small set."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(cases, "SECONDS", 8.0)
        rows = [(track, row) for track, one in experiments("follow", SMALL) for row in run(one)]
        return make_entry("follow", "", rows, SMALL)


def changed(path: Path, **values: object) -> Path:
    """Write other values into an entry's file, and leave its hash."""
    data = json.loads(path.read_text())
    path.write_text(json.dumps({**data, **values}))
    return path


def test_the_set_is_that_of_this_version() -> None:
    """Who changes the floors, fleets, seeds or bodies raises VERSION, and makes the shipped entries anew."""
    assert (VERSION, set_hash()) == (1, "471d8b31d38447ec")
    assert sum(case.episodes for case in CASES) == 40


def test_the_hash_of_the_set_tells_each_part_of_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Other robots, another floor, another seed: another hash."""
    seen = {set_hash(SMALL), set_hash(SMALL[:1]), set_hash((SMALL[0]._replace(robots=3), SMALL[1]))}
    seen.add(set_hash((SMALL[0], SMALL[1]._replace(layout="aisles:seed=802"))))
    monkeypatch.setattr(cases, "SEED", cases.SEED + 1)
    seen.add(set_hash(SMALL))
    assert len(seen) == 5


def test_tracks_are_the_same_for_all_but_when_right_of_way_steps_in() -> None:
    """No policy has the field on one track and not on the other; only raw actions go without right of way."""
    for policy in ("follow", "greedy", "ppo", "threaded_ppo", "orca", "apf"):
        spec = config_of(policy, EnvConfig(), options(policy, "field")).traffic_spec
        assert (spec.shield, spec.right_of_way, spec.routes) == (True, True, True)
        assert config_of(policy, EnvConfig(), options(policy, "bare")).traffic == "routes"
    named = {policy: config_of(policy, EnvConfig(), options(policy, "field")).traffic for policy in ("greedy", "ppo")}
    assert named == {"greedy": "rules", "ppo": "assist"}  # greedy says itself: at once


def test_the_shipped_entries_are_of_this_set() -> None:
    """Its hash says switches by the names that they had when the set was made."""
    assert set_hash() == "471d8b31d38447ec"


@pytest.mark.usefixtures("short")
def test_an_entry_is_read_as_it_was_written(entry: Entry, tmp_path: Path) -> None:
    """Each row has its track, and nothing is lost on the way."""
    write_entry(entry, tmp_path / "a.json")
    assert read_entry(tmp_path / "a.json") == entry
    assert [row["track"] for row in entry.rows] == ["field"] * 3 + ["bare"] * 3
    assert not list(faults(entry, SMALL))


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"policy": "mine"}, "was changed after it was written"),
        ({"rows": []}, "was changed after it was written"),
        ({"benchmark": 99}, "is of version 99"),
        ({"benchmark": None}, "is no entry"),
    ],
)
def test_a_changed_entry_is_told(entry: Entry, tmp_path: Path, values: dict[str, object], said: str) -> None:
    """In one sentence that says what to do."""
    write_entry(entry, tmp_path / "a.json")
    with pytest.raises(WarehouseError, match=said):
        read_entry(changed(tmp_path / "a.json", **values))


@pytest.mark.usefixtures("short")
def test_an_entry_that_lacks_episodes_does_not_stand(entry: Entry) -> None:
    """Nor does one of another set."""
    short = Entry(entry.policy, "", entry.rows[1:], set=entry.set)
    assert "1 are missing" in " ".join(faults(short, SMALL))
    assert "another set" in " ".join(faults(entry, SMALL[:1]))


@pytest.mark.usefixtures("short")
def test_episodes_come_again(entry: Entry) -> None:
    """Driven again they are the same to the digit; a figure that was made up is found."""
    assert not list(drive_again(entry, "follow", 3, SMALL))
    better = [{**row, "late_goals_per_robot_hour": 500.0} for row in entry.rows]
    told = list(drive_again(Entry("follow", "", tuple(better), set=entry.set), "follow", 6, SMALL))
    assert len(told) == 6
    assert "the entry says 500.0" in told[0]


@pytest.mark.usefixtures("short")
def test_who_was_trained_under_the_field_is_on_its_track_alone(entry: Entry) -> None:
    """And is whole with that; all others are asked for both."""
    assert [cases.tracks(policy) for policy in ("greedy", "threaded_ppo")] == [["field", "bare"], ["field"]]
    field = Entry("follow", "", entry.rows[:3], set=entry.set)
    assert not any("missing" in fault for fault in faults(field, SMALL))
    assert [len(table.cells) for table in board([field], SMALL)] == [1, 0]
    assert "3 are missing" in " ".join(faults(Entry("follow", "", entry.rows[3:], set=entry.set), SMALL))


def test_the_board_has_the_best_first(entry: Entry) -> None:
    """By goals, a table a track; contacts are all of a track's over all its kilometres."""
    better = Entry("better", "", tuple({**row, "late_goals_per_robot_hour": 9999.0} for row in entry.rows))
    tables = board([entry, better], SMALL)
    assert [table.title.partition(":")[0] for table in tables] == list(TRACKS)
    assert [line[0] for line in tables[0].cells] == ["better", "follow"]
    bare = [row for row in entry.rows if row["track"] == "bare"]
    contacts = sum(row["collisions_robot"] + row["collisions_shelf"] for row in bare)
    line = dict(zip(tables[1].header, tables[1].cells[1], strict=True))
    assert float(line["contacts/km"]) == pytest.approx(contacts / sum(row["robot_km"] for row in bare), rel=0.06)


def test_the_shipped_entries_stand_on_the_board(capsys: pytest.CaptureFixture[str]) -> None:
    """They are of this version's set, whole and unchanged, and the command shows them."""
    shipped = [read_entry(path) for path in SHIPPED.glob("*.json")]
    assert {"greedy", "threaded_ppo", "ppo"} <= {entry.policy for entry in shipped}
    assert not [fault for entry in shipped for fault in faults(entry)]
    assert all(set(row) == set(COLUMNS) for entry in shipped for row in entry.rows)
    assert main(["benchmark"]) == 0
    printed = capsys.readouterr().out
    assert "threaded_ppo" in printed
    assert "not on the board" not in printed


def test_the_command_says_what_is_wrong(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Before anything drives."""
    assert main(["benchmark", "--policy", "nobody"]) == 2
    assert main(["benchmark", "--check"]) == 2
    assert main(["benchmark", "--policy", "greedy", "--name", "../mine"]) == 2
    assert main(["benchmark", "--entries", str(tmp_path / "none.json")]) == 2
    said = capsys.readouterr().err
    assert all(text in said for text in ("nobody", "--check needs", "--name '../mine'", "none.json"))
