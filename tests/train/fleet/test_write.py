"""Orders and states of a story by hand; what is written passes a check that shares no code."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.train.fleet.stories import NAMES, episode_story, sent, story
from train.fleet.check import check_log
from train.fleet.messages import write_log
from train.fleet.vehicle import messages_of
from warehouse_env.errors import ConfigError


def test_orders_stitch_where_a_route_is_replaced() -> None:
    orders = [message.payload for message in sent(story(), "order")]
    said = [
        (one["orderId"], one["orderUpdateId"],
         [(node["nodeId"], node["sequenceId"], node["released"]) for node in one["nodes"]])
        for one in orders
    ]  # fmt: skip
    # 9 m east with a node every 2 m, and one after 4 m, where the route is replaced: the base ends there.
    assert said[0] == ("00000-1", 0, [
        ("100.500,-19.500", 0, True), ("102.500,-19.500", 2, True), ("104.500,-19.500", 4, True),
        ("104.500,-19.500", 6, False), ("106.500,-19.500", 8, False), ("108.500,-19.500", 10, False),
        ("109.500,-19.500", 12, False)])  # fmt: skip
    # The update continues from the last node of the base, 5 m north.
    assert said[1] == ("00000-1", 1, [
        ("104.500,-19.500", 4, True), ("104.500,-17.500", 6, True), ("104.500,-15.500", 8, True),
        ("104.500,-14.500", 10, True)])  # fmt: skip
    assert said[2][:2] == ("00000-2", 0)
    assert said[2][2][0] == ("104.500,-14.500", 0, True)
    assert [one["nodes"][-1]["actions"] for one in orders[1:]] == [
        [{"actionType": kind, "actionId": f"00000-{k}", "blockingType": "HARD"}]
        for k, kind in ((1, "pick"), (2, "drop"))
    ]
    assert [message.seconds for message in sent(story(), "order")] == [0.0, 4.0, 9.0]


def test_states_tell_what_is_left_and_what_is_carried() -> None:
    states = {(message.seconds, message.payload["orderId"]): message.payload for message in sent(story(), "state")}
    first = states[0.0, "00000-1"]
    assert [node["sequenceId"] for node in first["nodeStates"]] == [2, 4, 6, 8, 10, 12]
    assert [edge["sequenceId"] for edge in first["edgeStates"]] == [1, 3, 5, 7, 9, 11]
    assert (first["lastNodeId"], first["driving"], first["loads"]) == ("100.500,-19.500", True, [])
    done, after = states[9.0, "00000-1"], states[9.0, "00000-2"]
    assert (done["nodeStates"], done["edgeStates"], done["lastNodeSequenceId"]) == ([], [], 10)
    assert done["actionStates"] == [{"actionId": "00000-1", "actionType": "pick", "actionStatus": "FINISHED"}]
    assert [load["loadId"] for load in after["loads"]] == ["00000-1"]
    assert after["agvPosition"] == {
        "x": 104.5, "y": -14.5, "theta": -3.1415, "mapId": "plan", "positionInitialized": True,
    }  # fmt: skip


def test_what_is_written_is_faultless(tmp_path: Path) -> None:
    one = episode_story()
    count = write_log(messages_of(one, NAMES), tmp_path)
    found = check_log(tmp_path)
    assert [fault.sentence for fault in found.faults] == []
    frames = len(one.replay.pose)
    assert (found.vehicles, found.messages["visualization"], found.messages["connection"]) == (7, 7 * frames, 14)
    assert sum(found.messages.values()) == count
    assert found.messages["state"] > found.messages["order"] >= 7


def test_a_robot_that_stands_sends_a_state_every_half_minute() -> None:
    still = story()
    still.replay.pose[:] = still.replay.pose[0]
    for values in (still.replay.route, still.replay.along, still.replay.speed):
        values[:] = 0
    still.replay.flags[:] = 1
    object.__setattr__(still.replay, "config", still.replay.config.replace(time_step=7.0))
    assert [message.seconds for message in sent(still, "state")] == [0.0, 28.0, 56.0]


def test_a_file_is_the_same_each_time_and_positions_may_come_more_seldom(tmp_path: Path) -> None:
    for name in "ab":
        write_log(messages_of(story(), NAMES, 2.0), tmp_path / name)
    first, second = ((tmp_path / name / "messages.jsonl").read_bytes() for name in "ab")
    assert first == second
    assert first.count(b"/visualization") == 6
    with pytest.raises(ConfigError, match="a step of the episode"):
        next(iter(messages_of(story(), NAMES, 0.1)))
