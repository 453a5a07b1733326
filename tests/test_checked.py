"""Dataclasses refuse wrong values in one sentence: whatever comes in, they work or ConfigError says what is wrong."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from warehouse_env.checked import Checked, from_plain
from warehouse_env.config import EnvConfig, RobotSpec
from warehouse_env.errors import ConfigError


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"keep_right": "x"}, "keep_right='x' must be a finite number"),
        ({"keep_right": True}, "keep_right=True must be a finite number"),
        ({"keep_right": 10**400}, "keep_right=10"),
        ({"speed_levels": 3}, "speed_levels=3 must be a list with a finite number in each place"),
        ({"speed_levels": "12"}, "speed_levels='12' must be a list"),
        ({"speed_levels": []}, r"speed_levels=\(\) must be 1 to 4096 numbers"),
        ({"lateral_offsets": [0.1] * 2000}, "lateral_offsets=.* must be at most 1024 numbers beside 4 speed_levels"),
        ({"num_agents": 2.0}, r"num_agents=2\.0 must be a whole number"),
        ({"num_agents": 10**9}, "num_agents=1000000000 must be a whole number from 1 to 100,000"),
        ({"num_agents": 10**5000}, "a value of type int"),
        ({"tasks": ["lifelong"]}, r"tasks=\['lifelong'\] must be one of lifelong, one_shot"),
        ({"layout": 3}, "layout=3 must be a text"),
        ({"service": 3}, "service=3 must be a ServiceSpec or None"),
        ({"traffic": "rulez"}, "traffic='rulez' must be one of none, routes, shield, rules, assist or a TrafficSpec"),
        ({"robot": None}, "robot=None must be a RobotSpec"),
        ({"sensor": RobotSpec()}, "sensor=.* must be a SensorSpec"),
        ({"time_step": 1e-30}, "time_step=1e-30 must be a number from 0.001 to 10"),
        ({"stuck_after": float("inf")}, "stuck_after=inf must be a finite number"),
        ({"traffic": "rules", "action_type": "raw"}, "raw"),
    ],
)
def test_wrong_values_are_named(changes: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ConfigError, match=sentence):
        EnvConfig(**changes)
    with pytest.raises(ConfigError, match=sentence):
        EnvConfig().replace(**changes)


def test_numbers_become_plain_python() -> None:
    config = EnvConfig(
        num_agents=np.int8(3), keep_right=np.float32(1), time_step=1, terminate_on_collision=np.bool_(True),
        speed_levels=np.array([1, 2]), lateral_offsets=[0, np.int64(1)], layout=Path("a/b.map"),  # type: ignore[arg-type]
    )  # fmt: skip
    plain = EnvConfig(
        num_agents=3, keep_right=1.0, time_step=1.0, terminate_on_collision=True, speed_levels=(1.0, 2.0),
        lateral_offsets=(0.0, 1.0), layout="a/b.map",
    )  # fmt: skip
    assert repr(config) == repr(plain)
    assert hash(config) == hash(plain)


def test_errors_of_from_dict_name_what_is_wrong() -> None:
    for data, sentence in (
        ([1], r"EnvConfig parameters must be an object of names and values, not \[1\]"),
        ({"robot": None}, "robot=None must be a RobotSpec"),
        ({"robot": {"width": "x"}}, "width='x'"),
        ({"traffic": {"margin": -0.1}}, "margin=-0.1"),
        ({"robot": {"widht": 1}}, "did you mean width"),
        ({1: 2}, "unknown EnvConfig parameter 1"),
        ({"smooth_routes": True}, "EnvConfig parameter 'smooth_routes' is no option any more: it is False for all"),
    ):
        with pytest.raises(ConfigError, match=sentence):
            EnvConfig.from_dict(data)  # type: ignore[arg-type]


@dataclasses.dataclass(frozen=True)
class Wheel(Checked):
    size: float = 1.0
    retired: ClassVar[dict[str, Any]] = {"spokes": 8}


@dataclasses.dataclass(frozen=True)
class Cart(Checked):
    wheel: Wheel = dataclasses.field(default_factory=Wheel)


def test_a_field_that_is_gone_is_passed_over_where_it_asks_for_nothing() -> None:
    """Files that were written when there was such a field stay readable."""
    assert EnvConfig.from_dict({"smooth_routes": False}) == EnvConfig()
    assert from_plain(Cart, {"wheel": {"size": 2, "spokes": 8}}) == Cart(Wheel(2.0))
    with pytest.raises(ConfigError, match="Wheel parameter 'spokes' is no option any more: it is 8 for all"):
        from_plain(Cart, {"wheel": {"spokes": 9}})
