"""The bench of the protective field: its drivers meet robots and shelves, its noise bites, and its tables add up."""

from __future__ import annotations

import pytest

from train.benchmarks import field


@pytest.fixture(autouse=True)
def _short(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(field, "EPISODE", 30)


@pytest.mark.parametrize("name", field.DRIVERS)
def test_whatever_drives_is_held_by_the_field_and_touches_nothing(name: str) -> None:
    config = field._config(name, "narrow", 24)
    row = field.drive(name, config, 30, 1)
    assert (row["collisions_robot"], row["collisions_shelf"], row["slips"], row["contacts_per_km"]) == (0, 0, 0, 0)
    assert row["robot_km"] > 0.05
    bare = field.drive(name, config.replace(traffic="none"), 30, 1)
    assert bare["collisions_robot"] + bare["collisions_shelf"] > 0 or name in ("ppo", "reinforce")


def test_noise_breaks_what_rests_on_exact_knowledge() -> None:
    config = field._with_margin(field._config("hunter", "paper46", 24), 0.0)
    exact, noisy = (field.drive("hunter", config, 60, 1, noise) for noise in ("none", "20%"))
    assert exact["contacts_per_km"] == 0
    assert noisy["contacts_per_km"] > 0
