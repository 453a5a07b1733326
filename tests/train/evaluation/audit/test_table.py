"""Test audits of a simulator, of manipulated states, and the texts of audit rows."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from train.commands.audit import audit_table, faults_of, sentences
from train.evaluation.audit.watcher import Audit, solid_of
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.simulation.simulator import Simulator

CONFIG = EnvConfig(layout="open", num_agents=3, planner="astar", people=2)


def audited(config: EnvConfig = CONFIG, worlds: int = 1) -> tuple[Simulator, Audit]:
    """Return a reset simulator and an audit that has seen it."""
    simulator, audit = Simulator(config, worlds), Audit(config)
    simulator.reset(4)
    audit(simulator, 0)
    return simulator, audit


@pytest.mark.parametrize("changes", [{}, {"action_repeat": 2}])
def test_simulator_passes_the_audit(changes: dict[str, object]) -> None:
    simulator, audit = audited(CONFIG.replace(**changes), worlds=2)
    rng = np.random.default_rng(1)
    space = simulator.action_space
    for step in range(1, 81):
        simulator.step(rng.integers(0, int(space.n), (2, 3)))  # type: ignore[attr-defined]
        audit(simulator, step)
    for world, row in enumerate(audit.rows()):
        assert row["faults"] == []
        assert row["steps"] == 80
        assert row["robot_km"] == pytest.approx(simulator.episode_metrics(world)["robot_km"], rel=0.01)


def test_moved_robot_is_a_jump() -> None:
    simulator, audit = audited()
    simulator.robots["motion"]["x"][0, 1] += 0.01
    audit(simulator, 1)
    (row,) = audit.rows()
    assert row["jumps"] == 1
    (fault,) = row["faults"]
    assert (fault["kind"], fault["robot"], fault["other"], fault["step"]) == ("jump", 1, None, 0)
    assert 0.005 < fault["size"] < 0.0101  # the part beyond the motion limits


def test_lasting_overlap_counts_once() -> None:
    simulator, audit = Simulator(CONFIG), Audit(CONFIG)
    simulator.reset(4)
    for name in ("x", "y", "heading", "cos", "sin"):
        simulator.robots["motion"][name][0, 2] = simulator.robots["motion"][name][0, 0]
    simulator.robots["motion"]["y"][0, 2] += 0.5
    for step in range(4):
        if step == 2:
            simulator.robots["motion"]["y"][0, 2] += 1.0  # a jump that ends the overlap
        audit(simulator, step)
    row = audit.rows()[0]
    assert (row["overlaps_robot"], row["jumps"]) == (1, 1)
    overlap = next(fault for fault in row["faults"] if fault["kind"] == "robot")
    assert (overlap["robot"], overlap["other"], overlap["step"], overlap["last_step"]) == (0, 2, 0, 1)
    assert row["deepest_m"] == overlap["size"] > 0
    assert row["closest_m"] == 0


def test_long_decision_intervals_are_refused() -> None:
    with pytest.raises(ConfigError, match="action_repeat=3 must be at most 2"):
        Audit(CONFIG.replace(action_repeat=3))


def test_obstacle_cells_count_from_the_origin() -> None:
    occupied = np.zeros((2, 3), dtype=np.bool_)
    occupied[0, 2] = True  # the top right cell
    solid = solid_of(GridMap(occupied))
    assert solid.shape == (3, 2)
    assert np.argwhere(solid).tolist() == [[2, 1]]


def fault(kind: str, size: float, other: int | None = None) -> dict[str, Any]:
    """Return a fault of robot 3 in step 62."""
    when = {"step": 62, "last_step": 62, "time": 0.0123}
    return {"kind": kind, "robot": 3, "other": other, **when, "size": size, "x": 1.0, "y": 2.0}


def row(policy: str, *faults: dict[str, Any], **more: Any) -> dict[str, Any]:
    """Return a row of an audit."""
    kinds = [one["kind"] for one in faults]
    counts = {f"overlaps_{kind}": kinds.count(kind) for kind in ("robot", "shelf", "person")}
    figures = {"limits": kinds.count("speed"), "jumps": kinds.count("jump"), "deepest_m": 0.006, "closest_m": 0.02}
    about = {"policy": policy, "layout": "narrow", "robots": 8, "seed": 77, "episode": 0, "robot_km": 0.25}
    return {**about, **counts, **figures, "differs_at": None, "faults": list(faults), **more}


def test_audit_table_adds_up() -> None:
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
    texts = list(sentences([one]))
    assert len(texts) == 5
    assert "mine on narrow, 8 robots, seed 77: robot 3 overlaps robot 9 by 6 mm 0.012 s in step 62" in texts[1]
