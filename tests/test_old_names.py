"""Configurations that were stored under the names of before mean the same by those of today."""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest

from train.learning.config import ReinforceConfig, ThreadedPPOConfig
from warehouse_env.checked import from_plain
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError
from warehouse_env.traffic_spec import TRAFFIC, ErrorBounds, TrafficSpec, UncertaintySpec

SHIELD = TrafficSpec(shield=True)
OLD: list[tuple[dict[str, Any], dict[str, Any]]] = [  # stored fields -> fields of today
    ({"map_file": "hall.map", "layout": "narrow"}, {"layout": "hall.map"}),
    ({"map_file": None, "layout": "narrow"}, {"layout": "narrow"}),
    ({"protective_field": True}, {"traffic": SHIELD}),
    ({"protective_field": False, "right_of_way": False, "reroute": False}, {"traffic": "none"}),
    ({"protective_field": True, "field_margin": 0.1}, {"traffic": TrafficSpec(shield=True, margin=0.1)}),
    ({"protective_field": True, "right_of_way": True}, {"traffic": TrafficSpec(shield=True, right_of_way=True)}),
    ({"protective_field": True, "right_of_way": True, "reroute": True}, {"traffic": "rules"}),
    (
        {"protective_field": True, "right_of_way": True, "right_of_way_after": 12.0, "reroute": True},
        {"traffic": "assist"},
    ),
    ({"reroute": True}, {"traffic": "routes"}),
    ({"reroute": True, "reroute_spec": {"only_barred": True, "every": 4.0}}, {"traffic": TrafficSpec(routes="barred")}),
    ({"reroute": False, "reroute_spec": {"only_barred": True, "every": 1.0}}, {"traffic": "none"}),
    ({"reroute": True, "planner": "astar", "reroute_spec": {"planner": "astar"}}, {"traffic": "routes"}),
    (
        {"protective_field": True, "field_spec": {"scanner_rays": 36, "unseen_speed": 1.5}}, {"traffic": SHIELD},
    ),
    ({"message_loss": 0.1, "message_burst": 5.0}, {"uncertainty": UncertaintySpec(loss=0.1, burst=5.0)}),
    ({"message_loss": 0.0, "field_spec": {}}, {"uncertainty": None}),
    ({"message_latency": 0.3}, {"uncertainty": UncertaintySpec(latency=0.3, declared=ErrorBounds())}),
    ({"message_latency": 0.3, "field_spec": {"latency": 0.3}}, {"uncertainty": UncertaintySpec(latency=0.3)}),
    ({"field_spec": {"latency": 0.3}}, {"uncertainty": UncertaintySpec(declared=ErrorBounds(latency=0.3))}),
    *(
        ({name: 0.02, "field_spec": {name: bound}}, {"uncertainty": UncertaintySpec(**{name: 0.02}, declared=declared)})
        for name in ("pose_error", "heading_error", "actuation_error")
        for bound, declared in ((0.02, None), (0.03, ErrorBounds(**{name: 0.03})))
    ),
]  # fmt: skip


@pytest.mark.parametrize(("stored", "today"), OLD)
def test_every_old_name_has_its_meaning(stored: dict[str, Any], today: dict[str, Any]) -> None:
    planner = {name: stored[name] for name in ("planner",) if name in stored}
    assert EnvConfig.from_dict(stored) == EnvConfig(**planner, **today)


@pytest.mark.parametrize(
    ("stored", "sentence"),
    [
        ({"traffic": "rules", "reroute": True}, "'reroute' is an old name of what 'traffic' says"),
        ({"uncertainty": None, "message_loss": 0.1}, "'message_loss' is an old name of what 'uncertainty' says"),
        ({"right_of_way": True}, "False without a shield"),
        ({"protective_field": 3}, r"TrafficSpec\.shield=3 must be True or False"),
        ({"reroute_spec": 3}, "reroute_spec must be an object"),
        ({"reroute": True, "reroute_spec": {"every": 2.0}}, r"'every' is no option any more: it is 4\.0 for all"),
        ({"reroute": True, "reroute_spec": {"evry": 2.0}}, "unknown TrafficSpec parameter 'evry'"),
        ({"field_spec": {"latncy": 0.3}}, "did you mean latency"),
        ({"protective_field": "lidar"}, r"TrafficSpec\.shield='lidar' must be True or False"),
        ({"map_file": 3}, "layout=3 must be a text"),
    ],
)
def test_what_makes_no_sense_is_refused_in_one_sentence(stored: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ConfigError, match=sentence):
        EnvConfig.from_dict(stored)


@pytest.mark.parametrize(
    ("kind", "stored", "traffic"),
    [
        (ReinforceConfig, {}, "routes"),
        (ReinforceConfig, {"protective_field": False, "reroute": False, "right_of_way_after": None}, "none"),
        (ReinforceConfig, {"protective_field": True, "right_of_way_after": 0.0}, "rules"),
        (ThreadedPPOConfig, {"right_of_way_after": None}, "shield"),
        (ThreadedPPOConfig, {"reroute": True}, "assist"),
        (
            ThreadedPPOConfig,
            {"right_of_way_after": 6.0},
            dataclasses.replace(TRAFFIC["assist"], right_of_way_after=6.0),
        ),
    ],
)
def test_a_training_goes_on_as_it_began(kind: Any, stored: dict[str, Any], traffic: Any) -> None:
    spec = TRAFFIC[traffic] if isinstance(traffic, str) else traffic
    assert from_plain(kind, stored).traffic_spec == spec
    assert from_plain(kind, from_plain(kind, stored).to_dict()) == from_plain(kind, stored)
    with pytest.raises(ConfigError, match="unknown"):
        from_plain(kind, {"traffic": "rules", "reroute": True})
