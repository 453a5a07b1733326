"""The table of what holds: shares, contacts and verdicts, from rows made by hand."""

from __future__ import annotations

from typing import Any

import pytest

from train.evaluation.robustness import measure, robust_table, verdict


def rows(name: str, goals: tuple[float, ...], contacts: float = 1.0, standing: float = 20.0) -> list[dict[str, Any]]:
    """Two episodes on each of two floors; goals: of the first floor, of the second one."""
    return [
        {
            "disturbance": name, "policy": "ppo", "layout": layout, "robots": robots, "episode": episode,
            "seconds": 300.0, "goals_per_robot_hour": goal + change, "robot_km": 2.0, "collisions_robot": contacts,
            "collisions_shelf": contacts / 2, "collisions_person": contacts / 4,
            "longest_standing_s": standing + change,
        }
        for (layout, robots), goal in zip((("open", 16), ("narrow", 32)), goals, strict=True)
        for episode, change in enumerate((-1.0, 1.0))
    ]  # fmt: skip


USUAL = rows("none", (100.0, 60.0))


def test_what_is_measured() -> None:
    found = measure(USUAL)
    # strata of standard error 1 each: half of sqrt(2), and with one degree of freedom each t = 4.303 of two
    assert (found.goals.mean, found.goals.high) == pytest.approx((80.0, 80.0 + 4.30265 * 2**0.5 / 2), rel=1e-5)
    assert (found.robot_contacts, found.shelf_contacts, found.standing) == (0.5, 0.25, 20.0)
    worse = measure(rows("delay", (90.0, 30.0)))
    assert worse.share_of(found) == 0.75
    assert worse.worst_floor(found) == (0.5, ("narrow", 32))


@pytest.mark.parametrize(
    ("goals", "contacts", "standing", "word"),
    [
        ((100.0, 60.0), 1.0, 20.0, "holds"),
        ((92.0, 52.0), 1.5, 79.0, "holds"),
        ((92.0, 51.0), 1.0, 79.0, "slower"),
        ((92.0, 51.0), 1.0, 80.0, "jams"),
        ((92.0, 51.0), 1.51, 80.0, "contacts"),
    ],
)
def test_verdicts(goals: tuple[float, ...], contacts: float, standing: float, word: str) -> None:
    assert verdict(measure(rows("delay", goals, contacts, standing)), measure(USUAL)) == word


def test_a_line_for_each_disturbance() -> None:
    table = robust_table([*USUAL, *rows("delay", (90.0, 30.0))])
    assert "open with 16, narrow with 32 robots; 2 episodes of 300 s each" in table.title
    first, second = table.cells
    assert first == ("undisturbed", "ppo", "80.0 [77.0, 83.0]", "", "", "0.50", "0.25", "0.12", "20", "")
    assert second[0] == "seen 0.2 s late"
    assert second[3:5] == ("75", "50 (narrow, 32)")
    assert second[-1] == "slower"
    assert all(word in table.note for word in ("contacts", "jams", "slower", "holds"))
