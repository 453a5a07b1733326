"""What a policy is asked on a lattice is what it is asked by a robot that stands there."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from agents import make_policy, policy_config
from agents.learned import LearnedPolicy
from train.evaluation.telling import CRUISE, MOMENTS, Asked, headings_along, map_of, rows_of_map
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError
from warehouse_env.render.probability_maps import View
from warehouse_env.simulation.simulator import Simulator
from warehouse_env.simulation.tasks.assignment import Assignment

CONFIG = policy_config("ppo", EnvConfig(planner="astar", tasks="one_shot"))


@pytest.mark.parametrize("name", sorted(MOMENTS))
def test_chances_are_those_of_a_robot_that_stands_there(name: str) -> None:
    moment = MOMENTS[name]()
    one = map_of(moment, "ppo", CONFIG)
    simulator = Simulator(CONFIG.replace(num_agents=len(moment.goals)), grid=moment.grid)
    start = np.array([*(other[:3] for other in moment.others), moment.ego])
    policy = make_policy("ppo", simulator.config)
    assert isinstance(policy, LearnedPolicy)
    table = [(speed, offset) for speed in CONFIG.speed_levels for offset in CONFIG.lateral_offsets]
    places = np.argwhere(np.isfinite(one.chances["stop or back up"]))
    assert len(places) > 500
    for r, c in places[::67]:
        simulator.reset_to([Assignment(start, np.array(moment.goals))], 0)
        pose = start.copy()
        pose[-1] = one.x[c], one.y[r], one.heading[r, c]
        assert simulator.put(pose[None], [[*(other[3] for other in moment.others), CRUISE]]).all()
        likely = np.exp(policy.preferences(simulator.observation[0, -1:])[0].astype(float))
        likely /= likely.sum()
        by_hand = {
            "stop or back up": sum(p for p, (speed, _) in zip(likely, table, strict=True) if speed <= 0),
            "drive slowly": sum(p for p, (speed, _) in zip(likely, table, strict=True) if 0 < speed < 1.5),
            "pass on the right": sum(p for p, (speed, o) in zip(likely, table, strict=True) if speed > 0 and o < 0),
            "pass on the left": sum(p for p, (speed, o) in zip(likely, table, strict=True) if speed > 0 and o > 0),
        }
        assert {key: chance[r, c] for key, chance in one.chances.items()} == pytest.approx(by_hand, abs=1e-6)


def test_nobody_is_asked_in_a_shelf_or_in_another_robot() -> None:
    moment = dataclasses.replace(MOMENTS["head_on"](), lattice=View(13.0, 19.0, 1.0, 5.0))
    one = map_of(moment, "ppo", CONFIG)
    stop = one.chances["stop or back up"]
    assert stop.shape == (len(one.y), len(one.x)) == (40, 30)
    asked = np.isfinite(stop)
    inside = (one.y > 2.0 + 0.3) & (one.y < 4.0 - 0.3)  # the aisle, less half a body
    assert not asked[~inside].any()
    away = (one.x < 15.85 - 0.15) | (one.x > 16.75 + 0.75)  # from the other's body, a nose before or a tail behind it
    assert asked[np.ix_(inside, away)].all()
    assert not asked[np.ix_(np.abs(one.y - 3.0) < 0.5, np.abs(one.x - 16.3) < 0.4)].any()
    for chance in one.chances.values():
        assert np.array_equal(np.isfinite(chance), asked)
        assert chance[asked].min() >= 0
        assert chance[asked].max() <= 1
    total = stop + one.chances["pass on the right"] + one.chances["pass on the left"]
    assert total[asked].max() <= 1 + 1e-9
    rows = rows_of_map(one)
    assert len(rows) == asked.sum()
    r, c = np.argwhere(asked)[7]
    assert (rows[7]["x"], rows[7]["y"], rows[7]["stop"]) == (one.x[c], one.y[r], stop[r, c])


def test_it_passes_on_the_right() -> None:
    """Before another in the middle of the aisle; to the right of one that heads east lies the south."""
    shielded = policy_config("threaded_ppo", CONFIG)
    bold = map_of(MOMENTS["head_on"](), "threaded_ppo", shielded)  # under the field, where the others rather stop
    assert np.nanmean(bold.chances["pass on the right"][:, (bold.x > 12.0) & (bold.x < 13.2)]) > 0.5
    one = map_of(MOMENTS["head_on"](), "ppo", CONFIG)
    right, left = one.chances["pass on the right"], one.chances["pass on the left"]
    meeting = (one.x > 12.0) & (one.x < 13.2)
    assert np.nanmean(right[:, meeting]) > 10 * np.nanmean(left[:, meeting])
    assert np.nanmean(right[:, one.x < 9.0]) < 0.1
    assert (one.route[(one.route[:, 0] > 9) & (one.route[:, 0] < 19), 1] < 2.8).all()  # in its right-hand lane


def test_headings_are_those_of_the_route() -> None:
    route = np.array([(0.0, 0.0), (4.0, 0.0), (4.0, 3.0)])
    points = np.array([(1.0, 2.0), (5.0, 2.0), (3.9, 9.0), (-1.0, 0.0)])
    assert headings_along(route, points) == pytest.approx([0.0, math.pi / 2, math.pi / 2, 0.0])


def test_a_rule_has_no_probabilities() -> None:
    with pytest.raises(ConfigError, match="policy 'greedy' has no probabilities"):
        Asked("greedy", policy_config("greedy", EnvConfig()))
