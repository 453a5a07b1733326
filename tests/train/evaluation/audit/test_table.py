"""Rows in words: the table adds up, each fault has its sentence."""

from __future__ import annotations

from typing import Any

from train.evaluation.audit.table import audit_table, faults_of, sentences


def fault(kind: str, size: float, other: int | None = None) -> dict[str, Any]:
    """A fault of robot 3 in step 62."""
    when = {"step": 62, "last_step": 62, "time": 0.0123}
    return {"kind": kind, "robot": 3, "other": other, **when, "size": size, "x": 1.0, "y": 2.0}


def row(policy: str, *faults: dict[str, Any], **more: Any) -> dict[str, Any]:
    """An audit's row."""
    kinds = [one["kind"] for one in faults]
    counts = {f"overlaps_{kind}": kinds.count(kind) for kind in ("robot", "shelf", "person")}
    figures = {"limits": kinds.count("speed"), "jumps": kinds.count("jump"), "deepest_m": 0.006, "closest_m": 0.02}
    about = {"policy": policy, "layout": "narrow", "robots": 8, "seed": 77, "episode": 0, "robot_km": 0.25}
    return {**about, **counts, **figures, "differs_at": None, "faults": list(faults), **more}


def test_the_table_adds_up() -> None:
    rows = [row("a"), row("a", fault("robot", 0.006, 9)), row("b", fault("speed", 0.1), closest_m=None)]
    table = audit_table(rows)
    assert [line[:11] for line in table.cells] == [
        ("narrow", "8", "a", "2", "0.5000", "1", "0", "0", "0", "0", "6"),
        ("narrow", "8", "b", "1", "0.2500", "0", "0", "0", "1", "0", "6"),
        ("all", "", "", "3", "0.7500", "1", "0", "0", "1", "0", "6"),
    ]
    assert [line[11] for line in table.cells] == ["20", "-", "20"]
    assert all(len(line) == len(table.header) for line in table.cells)


def test_each_fault_has_a_sentence() -> None:
    faults = [fault("robot", 0.006, 9), fault("shelf", 0.001), fault("speed", 0.1), fault("jump", 0.01)]
    one = row("runs/mine", *faults, differs_at=5, episode="e.npz")
    assert faults_of(one) == 5
    said = list(sentences([one]))
    assert len(said) == 5
    assert "mine on narrow, 8 robots, seed 77: robot 3 overlaps robot 9 by 6 mm 0.012 s in step 62" in said[1]
