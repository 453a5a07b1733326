"""Test `warehouse tables`: output of papers, planners and floors, resuming, and refusals."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from train.cli import main
from train.evaluation.jobs import Result, Tick
from train.reporting.rows import Interval, Row, read_rows, write_rows
from train.tables import catalogue, floors, published, runner
from train.tables.floors import DRAWN, LARGE, FloorsTable, floors_table
from train.tables.measures import MEASURES
from train.tables.papers import settings
from train.tables.published import publish
from train.tables.runner import PlanBlock
from warehouse_env.planning import PLANNERS


def tables(folder: Path, *options: str) -> int:
    return main(["tables", "papers", "--out", str(folder), "--processes", "1", *options])


@pytest.fixture
def blocks(monkeypatch: pytest.MonkeyPatch) -> list[PlanBlock]:
    """Return a list that records the blocks in the order they run."""
    done: list[PlanBlock] = []
    run = PlanBlock.run

    def counts(block: PlanBlock, tick: Tick) -> Result:
        done.append(block)
        return run(block, tick)

    monkeypatch.setattr(PlanBlock, "run", counts)
    return done


@pytest.mark.usefixtures("toy")
def test_rows_tables_and_verdicts(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert tables(tmp_path) == 0
    rows = read_rows(tmp_path / "rows.jsonl")
    assert len(rows) == 2 * 3 * 3  # systems, tasks, runs
    for row in rows:
        assert row["length"] >= row["optimal_length"] - 1e-9
        assert row["cpu_ms"] > 0
        assert {"study", "setting", "number", "system", "map", "code", "version", "seed", "runs"} <= set(row)
    counts = "Of 1 claims 0 hold, 0 hold in part and 1 do not hold."
    assert counts in capsys.readouterr().out
    page = (tmp_path / "README.md").read_text()
    for text in (
        counts, "**open** (optimum 5.65685, 0 turns)", "*in print: theirs*", "*in print: another*",
        "| **does not hold** | ants are as good |", "A note.",
    ):  # fmt: skip
        assert text in page


@pytest.mark.usefixtures("toy")
def test_tables_resume_after_a_stop(
    tmp_path: Path, blocks: list[PlanBlock], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    run = PlanBlock.run

    def stopped(block: PlanBlock, tick: Tick) -> Result:
        if len(blocks) == 2:
            raise KeyboardInterrupt
        return run(block, tick)

    with monkeypatch.context() as patch:
        patch.setattr(PlanBlock, "run", stopped)
        assert tables(tmp_path) == 130
    assert "6 rows are kept" in capsys.readouterr().err
    path = tmp_path / "rows.jsonl"
    path.write_text(path.read_text()[:-30])  # as after a kill
    blocks.clear()
    assert tables(tmp_path) == 2
    assert "--resume keeps them and goes on" in capsys.readouterr().err
    assert tables(tmp_path, "--resume") == 0
    assert len(blocks) == 6 - 1
    assert tables(tmp_path, "--resume") == 0
    assert len(blocks) == 5
    assert tables(tmp_path, "--overwrite") == 0
    assert len(blocks) == 11
    assert len(read_rows(path)) == 18


@pytest.mark.usefixtures("toy")
def test_rows_of_other_code_maps_parameters_or_seeds_are_not_reused(tmp_path: Path, blocks: list[PlanBlock]) -> None:
    assert tables(tmp_path, "--runs", "2") == 0
    path = tmp_path / "rows.jsonl"
    for name in ("code", "version", "map", "parameters"):
        rows = [{**row, name: "other"} if row["system"] == "ants" else row for row in read_rows(path)]
        path.write_text("".join(json.dumps(row) + "\n" for row in rows))
        blocks.clear()
        assert tables(tmp_path, "--runs", "2", "--resume") == 0
        assert [block.system for block in blocks] == ["ants"] * 3
    assert tables(tmp_path, "--runs", "2", "--seed", "1", "--resume") == 0
    assert len(blocks) == 3 + 6


def test_check_compares_each_line_with_the_published_one(
    toy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    lines = tmp_path / "published.jsonl"
    monkeypatch.setattr(published, "PUBLISHED", lines)
    monkeypatch.setattr(published, "FOLDER", toy.parent)
    assert tables(tmp_path) == 0
    publish([tmp_path / "rows.jsonl"])
    known = read_rows(lines)
    assert [(one["setting"], one["system"], one["maps"], one["runs"]) for one in known] == [
        ("open", "ants", 1, 3), ("open", "dijkstra", 1, 3), ("shelves", "ants", 2, 3), ("shelves", "dijkstra", 2, 3),
    ]  # fmt: skip
    capsys.readouterr()

    def check(changed: dict[str, Any], *options: str) -> tuple[int, list[str]]:
        write_rows(lines, [{**known[0], "figures": {**known[0]["figures"], **changed}}, *known[1:]])
        code = tables(tmp_path, "--check", *options)
        shown = capsys.readouterr().out
        return code, [line for line in shown.splitlines() if "│ toy" in line]

    code, shown = check({}, "--resume")
    assert (code, len(shown)) == (0, 4)
    assert all("same" in line for line in shown)
    length = known[0]["figures"]["mean"][0]
    code, shown = check({"mean": [length + 0.1, length, length + 0.2]}, "--resume")
    assert code == 0
    assert "mean length 5.657 against 5.757 [5.657, 5.857]: no interval" in shown[0]  # three equal runs
    code, shown = check({"mean": [length + 0.3] * 3}, "--resume")
    assert code == 1
    assert "outside" in shown[0]
    code, shown = check({"best": [1.0, None, None]}, "--resume")
    assert code == 0
    assert "best length 5.657 against 1: no interval" in shown[0]
    code, shown = check({"turns": [None, None, None]}, "--runs", "2", "--overwrite")
    assert code == 1
    assert "against -: outside" in shown[0]


@pytest.mark.parametrize(("mean", "word"), [(10.3, "within"), (10.5, "outside"), (9.5, "outside"), (np.nan, "outside")])
def test_figures_agree_within_twice_the_differences_interval(mean: float, word: str) -> None:
    """Half widths of 0.12 and 0.16 combine to 0.2."""
    assert published._word(Interval(mean, mean - 0.12, mean + 0.12, 5), Interval(10.0, 9.84, 10.16, 9)) == word


def test_published_lines_match_the_present_tables() -> None:
    known = {(line["study"], line["setting"], line["system"]): line for line in read_rows(published.PUBLISHED)}
    wanted: dict[tuple[str, ...], tuple[set[str], int]] = {}
    for file in catalogue.PAPERS:
        for study in catalogue.studies_of(file).values():
            names = {name for name in study.measures if not MEASURES[name].clock}
            for setting in catalogue.settings_of(file, study.name):
                wanted |= {(study.name, setting, one.label): (names, study.runs) for one in study.systems}
    assert {place: (set(line["figures"]), line["runs"]) for place, line in known.items()} == wanted


def test_other_papers_keep_their_rows(tmp_path: Path, toy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    other = toy.read_text().replace('"toy"\ntitle = "A', '"toy_2"\ntitle = "Another')
    toy.with_stem("toy_2").write_text(other)
    monkeypatch.setattr(runner, "PAPERS", ("toy", "toy_2"))
    for name in ("toy", "toy_2"):
        assert tables(tmp_path, "--papers", name, "--runs", "1", "--resume") == 0
    page = (tmp_path / "README.md").read_text()
    assert "Another toy" in page
    assert "A toy table" not in page
    assert len(read_rows(tmp_path / "rows.jsonl")) == 2 * 6


def test_planners_table_on_pairs_of_cells(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(catalogue, "PLANNERS", {name: PLANNERS[name] for name in ("astar", "dijkstra", "apf")})
    monkeypatch.setattr(settings, "PAIRS", 2)
    catalogue.studies_of.cache_clear()
    catalogue.settings_of.cache_clear()
    asked = ["tables", "planners", "--runs", "1", "--processes", "1", "--out", str(tmp_path)]
    assert main(asked) == 0
    page = (tmp_path / "planners" / "README.md").read_text()
    for name in ("paper46", "narrow", "clutter20", "clutter35", "warehouse-10-20-10-2-2"):
        assert f"**{name}**" in page
    exact = [row for row in read_rows(tmp_path / "planners" / "rows.jsonl") if row["planner"] != "apf"]
    assert len(exact) == 2 * 2 * 5
    assert all(row["gap"] < 1e-9 for row in exact)
    assert settings.movingai_warehouse().shape == (84, 170)  # as in the archive of Stern et al.
    catalogue.studies_of.cache_clear()
    catalogue.settings_of.cache_clear()


def row(policy: str, layout: str, seed: int, late: float, robots: int = 4, **more: Any) -> Row:
    return {
        "policy": policy, "layout": layout, "robots": robots, "seed": seed,
        "late_goals_per_robot_hour": late,
        "stuck": 0.0, "longest_standing_s": 10.0, "collisions_robot": 0.0, "collisions_shelf": 0.0, "robot_km": 2.5,
        **more,
    }  # fmt: skip


ROWS = [
    row("greedy", "aisles:seed=1", 0, 100.0, robots=1),
    row("greedy", "aisles:seed=2", 1, 100.0, robots=1),
    row("greedy", "aisles:seed=1", 0, 60.0),
    row("greedy", "aisles:seed=2", 1, 80.0, longest_standing_s=33.0),
    row("ppo", "aisles:seed=1", 0, 66.0, stuck=0.25, collisions_robot=2.0),
    row("ppo", "aisles:seed=2", 1, 88.0),
]


def test_floors_table_by_hand() -> None:
    table = floors_table(ROWS, ["ppo"])
    rule, ours = (dict(zip(table.header, line, strict=True)) for line in table.cells)
    assert (rule["floor"], rule["robots"], rule["policy"]) == ("drawn at random", "4", "greedy")
    assert (rule["% of alone"], rule["above the rule"], rule["stood s"], rule["km"]) == ("70", "", "33", "5")
    assert rule["late goals/h"] == "70 [0, 197]"  # 60 and 80, +- 12.706 * 14.14 / 1.414, clipped at 0
    # paired 6 and 8: 7 +- 12.706 * 1.414 / 1.414 = 12.7
    assert ours["above the rule"] == "+7.0 [-5.7, 19.7], may be chance"
    assert (ours["% of alone"], ours["stuck %"], ours["contacts"]) == ("77", "12", "2")
    assert len(floors_table(ROWS, ["greedy", "ppo"]).cells) == 2  # the rule appears once


def test_rule_and_policies_share_the_seeds_of_a_floor(tmp_path: Path) -> None:
    made = list(FloorsTable(out=tmp_path, policy=("ppo", "brake")).experiments())
    seeds: dict[tuple[str, int], set[tuple[int, ...]]] = {}
    for one in made:
        seeds.setdefault((one.config.layout, one.config.num_agents), set()).add(tuple(one.seeds))
    assert all(len(group) == 1 for group in seeds.values())
    assert len({place for place, _ in seeds}) == 3 + len(DRAWN) + len(LARGE)
    crowds = {robots for place, robots in seeds if place.startswith("blocks")}
    assert crowds == {1, 256, 512, 1024}
    assert all(one.seed >= floors.SEED for one in made)


def test_small_floors_study_runs_and_resumes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(floors, "SECONDS", 8.0)
    monkeypatch.setattr(floors, "ALONE", 3)
    asked = [
        "tables", "floors", "--maps", "open", "aisles:seed=3", "--policy", "follow", "--robots", "2", "--runs", "2",
        "--out", str(tmp_path), "--processes", "1", "--resume",
    ]  # fmt: skip
    assert main(asked) == 0
    assert main(asked) == 0  # runs no episode again
    rows = read_rows(tmp_path / "floors" / "rows.jsonl")
    assert len(rows) == (3 + 2) * 2 + (3 + 2)  # one robot alone, and both policies; one floor runs twice as often
    assert "drawn at random" in (tmp_path / "floors" / "README.md").read_text()
    assert main([*asked, "--maps", "aisle:seed=3"]) != 0
    assert "aisles" in capsys.readouterr().err
