"""Test kinds of robots by share: fleets of any size, and the file of kinds."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from train.commands.evaluate import Evaluate
from train.kinds import Fleet, KindPart, Kinds, read_fleet
from warehouse_env.config import EnvConfig, FleetPart, RobotSpec
from warehouse_env.errors import ConfigError

LONG = RobotSpec(length=1.4, max_speed=0.8)
SMALL = RobotSpec(length=0.5, width=0.4, wheelbase=0.3)


def shares(*given: float) -> Kinds:
    """Return kinds with these shares: LONG, SMALL and others that differ in mass."""
    kinds = [LONG, SMALL, *(RobotSpec(mass=100.0 + k) for k in range(len(given)))]
    return Kinds(tuple(KindPart(robot, share=share) for robot, share in zip(kinds, given, strict=False)))


def count_by_kind(kinds: Kinds, robots: int, first: int = 0) -> Counter[RobotSpec]:
    return Counter(EnvConfig(num_agents=robots, **kinds.of(robots, first)).robots)


def test_single_kind_fills_fleets_of_any_size() -> None:
    for robots in (1, 2, 1000):
        assert shares(1.0).of(robots) == {"robot": LONG, "fleet": ()}
    assert shares(1.0).words == "1.4 x 0.6 m, up to 0.8 m/s, braking at 1 m/s²"


def test_shares_by_hand() -> None:
    quarter = shares(0.25)
    assert quarter.of(8) == {"robot": RobotSpec(), "fleet": (FleetPart(2, LONG),)}
    assert [count_by_kind(quarter, robots)[LONG] for robots in range(1, 11)] == [0, 0, 1, 1, 1, 1, 2, 2, 2, 2]
    assert shares(0.6, 0.4).of(5) == {"robot": LONG, "fleet": (FleetPart(2, SMALL),)}  # no share left for the default
    tenths = shares(*[0.1] * 10)  # their float sum is not exactly 1
    assert set(count_by_kind(tenths, 10).values()) == {1}
    assert tenths.of(10)["robot"] == LONG
    assert quarter.each() == {"robot": RobotSpec(), "fleet": (FleetPart(1, LONG),), "num_agents": 2}
    assert quarter.words.startswith("2 kinds: 75% of 0.9 x 0.6 m, up to 1.5 m/s, braking at 1 m/s²; 25% of 1.4 x 0.6 m")


@pytest.mark.parametrize("given", [(0.25,), (0.3, 0.3), (0.43, 0.43, 0.14), (0.05, 0.05, 0.45, 0.45), (0.001,)])
def test_larger_fleets_extend_smaller_ones(given: tuple[float, ...]) -> None:
    """Largest remainders would fail: with 0.43, 0.43, 0.14 the last kind has 2 of 10 but 1 of 11."""
    kinds, before = shares(*given), Counter[RobotSpec]()
    wanted = dict(zip([LONG, SMALL, RobotSpec(mass=100.0), RobotSpec(mass=101.0)], given, strict=False))
    for robots in range(1, 300):
        found = count_by_kind(kinds, robots)
        assert found.total() == robots
        assert found >= before
        assert all(abs(found[robot] - share * robots) < 1.0 for robot, share in wanted.items())
        before = found


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("{}", "must be a list"), ('[{"share": 0.2}]', "lacks the entry 'robot'"),
        ('[{"share": 0, "robot": {}}]', "share=0.0 must be a number above 0, up to 1"),
        ('[{"share": 0.6, "robot": {}}, {"share": 0.5, "robot": {}}]', "make 1.1 together, and must make 1 at most"),
        ('[{"share": 1, "count": 1, "robot": {}}]', "unknown KindPart parameter 'count'"),
    ],
)  # fmt: skip
def test_wrong_fleet_file_is_one_sentence(text: str, why: str, tmp_path: Path) -> None:
    path = tmp_path / "fleet.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=f"fleet .*fleet.json.*{why}"):
        read_fleet(path)


def test_fleet_option_scales_with_the_number_of_robots(tmp_path: Path) -> None:
    path = tmp_path / "fleet.json"
    path.write_text('[{"share": 0.5, "robot": {"length": 1.4, "max_speed": 0.8}}]', encoding="utf-8")
    found = Evaluate(policy=("brake",), robots=(4, 9), layout=("open",), fleet=path).experiments()
    assert [one.config.fleet for one in found] == [(FleetPart(2, LONG),), (FleetPart(4, LONG),)]
    assert Fleet().kinds() is None
