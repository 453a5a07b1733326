"""Test orders and states of a hand-made story, the check with each rule broken once, and the command."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tests.render.conftest import driven
from tests.train.fleet.stories import NAMES, episode_story, lines, sent, story, write_lines
from train.cli import main
from train.fleet.check import check_log
from train.fleet.messages import Sender, body_of, write_log
from train.fleet.received import hear_log
from train.fleet.vehicle import messages_of
from warehouse_env.errors import ConfigError, WarehouseError


def test_orders_stitch_where_a_route_is_replaced() -> None:
    orders = [message.payload for message in sent(story(), "order")]
    sent_orders = [
        (one["orderId"], one["orderUpdateId"],
         [(node["nodeId"], node["sequenceId"], node["released"]) for node in one["nodes"]])
        for one in orders
    ]  # fmt: skip
    # 9 m east with a node every 2 m; the base ends after 4 m, where the route is replaced.
    assert sent_orders[0] == ("00000-1", 0, [
        ("100.500,-19.500", 0, True), ("102.500,-19.500", 2, True), ("104.500,-19.500", 4, True),
        ("104.500,-19.500", 6, False), ("106.500,-19.500", 8, False), ("108.500,-19.500", 10, False),
        ("109.500,-19.500", 12, False)])  # fmt: skip
    # The update continues 5 m north from the last node of the base.
    assert sent_orders[1] == ("00000-1", 1, [
        ("104.500,-19.500", 4, True), ("104.500,-17.500", 6, True), ("104.500,-15.500", 8, True),
        ("104.500,-14.500", 10, True)])  # fmt: skip
    assert sent_orders[2][:2] == ("00000-2", 0)
    assert sent_orders[2][2][0] == ("104.500,-14.500", 0, True)
    assert [one["nodes"][-1]["actions"] for one in orders[1:]] == [
        [{"actionType": kind, "actionId": f"00000-{k}", "blockingType": "HARD"}]
        for k, kind in ((1, "pick"), (2, "drop"))
    ]
    assert [message.seconds for message in sent(story(), "order")] == [0.0, 4.0, 9.0]


def test_states_list_remaining_nodes_and_loads() -> None:
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


def test_written_log_passes_the_check(tmp_path: Path) -> None:
    one = episode_story()
    count = write_log(messages_of(one, NAMES), tmp_path)
    found = check_log(tmp_path)
    assert [fault.sentence for fault in found.faults] == []
    frames = len(one.replay.pose)
    assert (found.vehicles, found.messages["visualization"], found.messages["connection"]) == (7, 7 * frames, 14)
    assert sum(found.messages.values()) == count
    assert found.messages["state"] > found.messages["order"] >= 7


def test_standing_robot_sends_a_state_every_28_s() -> None:
    still = story()
    still.replay.pose[:] = still.replay.pose[0]
    for values in (still.replay.route, still.replay.along, still.replay.speed):
        values[:] = 0
    still.replay.flags[:] = 1
    object.__setattr__(still.replay, "config", still.replay.config.replace(time_step=7.0))
    assert [message.seconds for message in sent(still, "state")] == [0.0, 28.0, 56.0]


def test_log_is_reproducible_and_positions_may_be_rarer(tmp_path: Path) -> None:
    for name in "ab":
        write_log(messages_of(story(), NAMES, 2.0), tmp_path / name)
    first, second = ((tmp_path / name / "messages.jsonl").read_bytes() for name in "ab")
    assert first == second
    assert first.count(b"/visualization") == 6
    with pytest.raises(ConfigError, match="a step of the episode"):
        next(iter(messages_of(story(), NAMES, 0.1)))


Log = list[dict[str, Any]]


def _of(log: Log, name: str, k: int = 0) -> dict[str, Any]:
    """Return a topic's payload."""
    payload: dict[str, Any] = [entry for entry in log if entry["topic"].endswith(f"/{name}")][k]["payload"]
    return payload


def _drop(log: Log, name: str, k: int) -> object:
    return log.pop([number for number, entry in enumerate(log) if entry["topic"].endswith(f"/{name}")][k])


BREAKS: dict[str, tuple[Callable[[Log], object], str]] = {
    "schema": (lambda log: _of(log, "state").pop("driving"), "schema: in this state"),
    "deep": (lambda log: _of(log, "order")["nodes"][0].update(released="yes"), "nodes/0/released"),
    "lost": (lambda log: _drop(log, "visualization", 3), "headerId 4 of visualization stands after 2"),
    "whose": (lambda log: _of(log, "order").update(serialNumber="8"), "it names vehicle"),
    "version": (lambda log: _of(log, "order").update(version="4.0.0"),
                "version: '4.0.0' is not read; --check reads 2.x and 3.x and skips the others"),
    "words": (lambda log: _of(log, "order").update(version="3.0.0"), "schema: in this order, 'nodes/0/"),
    "topic's version": (lambda log: log[2].update(topic=log[2]["topic"].replace("v2", "v3")), "not that of the topic"),
    "odd version": (lambda log: _of(log, "order").update(version="v2.1.0"), "'v2.1.0' is not MAJOR.MINOR.PATCH"),
    "no version": (lambda log: _of(log, "order").pop("version"), "'version' is a required property"),
    "back": (lambda log: _of(log, "state", 2).update(timestamp="2025-12-31T23:59:59Z"), "is before that of the last"),
    "zone": (lambda log: _of(log, "state").update(timestamp="2026-01-01T00:00:00"), "is not ISO 8601"),
    "silent": (lambda log: [
        entry["payload"].update(timestamp="2026-01-01T00:01:00Z") for entry in log if entry["topic"].endswith("state")
        and entry["payload"]["orderId"] == "00000-2"], "no state for 5"),
    "silent to the end": (lambda log: [
        _of(log, "connection").update(timestamp="2025-12-31T23:58:00Z"), _drop(log, "connection", 1),
        *(entry["payload"].update(timestamp="2025-12-31T23:59:00Z") for entry in log if entry["topic"][-5:] == "state"),
    ], "no state for 7"),
    "quality": (lambda log: log[0].update(qos=0), "sent with QoS 0, not 1"),
    "topic": (lambda log: log[3].update(topic="a/b"), "is not INTERFACE"),
    "online": (lambda log: _of(log, "connection", 1).update(connectionState="ONLINE"), "ONLINE again"),
    "stitch": (lambda log: _of(log, "order", 1)["nodes"][0].update(sequenceId=6), "order: "),
    "base": (lambda log: _of(log, "order", 0)["nodes"][1].update(released=False), "not followed by its horizon"),
    "update": (lambda log: _of(log, "order", 1).update(orderUpdateId=0), "update 0 of order '00000-1' comes after 0"),
    "edges": (lambda log: _of(log, "order", 0)["edges"].pop(), "7 nodes and 5 edges"),
    "too early": (lambda log: _of(log, "order", 1).update(orderId="other"), "while '00000-1' is under way"),
    "nodes": (lambda log: _of(log, "state")["nodeStates"].pop(), "its nodeStates are not"),
    "states' edges": (lambda log: _of(log, "state")["edgeStates"].pop(0), "its edgeStates are not"),
    "last node": (lambda log: _of(log, "state").update(lastNodeId="nowhere"), "is not in its base"),
    "unknown": (lambda log: _of(log, "state").update(orderUpdateId=5), "which was not sent"),
    "beyond": (lambda log: _of(log, "state").update(lastNodeSequenceId=6, lastNodeId="104.500,-19.500"),
               "not in its base"),
}  # fmt: skip


BREAKS_3: dict[str, tuple[Callable[[Log], object], str]] = {
    "schema": (lambda log: _of(log, "state").pop("powerSupply"), "schema: in this state"),
    "position": (lambda log: _of(log, "visualization")["mobileRobotPosition"].pop("x"), "in this visualization"),
    "state": (lambda log: _of(log, "visualization").update(referenceStateHeaderId=9), "refers to state 9; the last"),
    "base": (lambda log: _of(log, "order", 0)["nodes"][1].update(released=False), "not followed by its horizon"),
    "silent": (lambda log: log[-1]["payload"].update(timestamp="2026-01-01T00:01:00Z"), "no state for 49"),
}  # fmt: skip


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fleet")
    write_log(messages_of(story(), NAMES), folder)
    return folder / "messages.jsonl"


@pytest.mark.parametrize(("major", "what"), [*((2, what) for what in BREAKS), *((3, what) for what in BREAKS_3)])
def test_check_finds_each_broken_rule(major: int, what: str, tmp_path: Path) -> None:
    write_log(messages_of(story(), replace(NAMES, major=major)), tmp_path)
    assert check_log(tmp_path).total == 0
    entries = lines(tmp_path / "messages.jsonl")
    spoil, message = (BREAKS if major == 2 else BREAKS_3)[what]
    spoil(entries)
    found = check_log(write_lines(tmp_path / "log.jsonl", entries))
    assert any(message in fault.sentence for fault in found.faults), [fault.sentence for fault in found.faults]


def test_version_3_holds_the_same_content(log: Path, tmp_path: Path) -> None:
    one = episode_story()
    heard = []
    for major in (2, 3):
        write_log(messages_of(one, replace(NAMES, major=major)), tmp_path / str(major))
        found = check_log(tmp_path / str(major))
        assert [fault.sentence for fault in found.faults] == []
        assert found.messages["visualization"] == 7 * len(one.replay.pose)
        heard.append(hear_log(tmp_path / str(major)))
    for key, vehicle in heard[0].vehicles.items():
        other = heard[1].vehicles[key]
        assert (other.reports == vehicle.reports).all()
        assert (other.told, other.connected) == (vehicle.told, vehicle.connected)
        assert body_of(other.factsheet) == body_of(vehicle.factsheet)
    entries = lines(tmp_path / "3" / "messages.jsonl")
    assert {entry["topic"].split("/")[1] for entry in entries} == {"v3"}
    assert {entry["payload"]["version"] for entry in entries} == {"3.0.0"}
    about = _of(entries, "factsheet")["typeSpecification"]  # extensible, so the schema cannot check its words
    assert (about["mobileRobotKinematics"], about["navigationTypes"]) == ("THREE_WHEEL", ["FREELY_NAVIGATING"])
    assert Sender(replace(NAMES, major=3), "1").last_will().payload["connectionState"] == "CONNECTION_BROKEN"


def test_cancelled_order_may_be_replaced(log: Path, tmp_path: Path) -> None:
    entries = lines(log)
    last = [k for k, entry in enumerate(entries) if entry["topic"].endswith("/order")][1]
    head = {**entries[last]["payload"], "headerId": 0}
    action = {"actionType": "cancelOrder", "actionId": "c", "blockingType": "HARD"}
    cancel = {key: head[key] for key in ("headerId", "timestamp", "version", "manufacturer", "serialNumber")}
    other = entries[last] | {"payload": {**head, "headerId": 1, "orderId": "other", "orderUpdateId": 0}}
    topic = entries[last]["topic"].replace("order", "instantActions")
    kept = [*entries[:last], entries[last] | {"topic": topic, "payload": cancel | {"actions": [action]}}, other]
    assert check_log(write_lines(tmp_path / "log.jsonl", kept)).total == 0


@pytest.mark.parametrize("version", ["4.0.0", "1.1.0"])
def test_log_of_another_version_is_refused_in_one_sentence(version: str, log: Path, tmp_path: Path) -> None:
    entries = lines(log)
    for entry in entries:
        entry["payload"]["version"] = version
        entry["topic"] = entry["topic"].replace("v2", f"v{version.strip('v')[0]}")
    with pytest.raises(WarehouseError, match=rf"log.jsonl.*'{version}'.*reads 2") as raised:
        check_log(write_lines(tmp_path / "log.jsonl", entries))
    assert "\n" not in str(raised.value)
    mixed = check_log(write_lines(tmp_path / "log.jsonl", [*lines(log), *entries]))
    assert [(fault.kind, fault.line) for fault in mixed.faults] == [("version", len(entries) + 1)]


def test_odd_version_is_one_fault_per_vehicle(log: Path, tmp_path: Path) -> None:
    entries = lines(log)
    for entry in entries:
        entry["topic"] = f"plant/hall 1/{entry['topic']}"
    assert check_log(write_lines(tmp_path / "log.jsonl", entries)).total == 0
    for entry in entries:
        entry["payload"]["version"] = "2.1"
    assert check_log(write_lines(tmp_path / "log.jsonl", entries)).total == 1


@pytest.mark.parametrize(("major", "broken"), [(2, "CONNECTIONBROKEN"), (3, "CONNECTION_BROKEN")])
def test_disconnected_vehicle_owes_no_state(major: int, broken: str, tmp_path: Path) -> None:
    """A will as old as the connection does not break the order of times either."""
    write_log(messages_of(story(), replace(NAMES, major=major)), tmp_path)
    entries = lines(tmp_path / "messages.jsonl")
    connections = [(broken, "2025-12-31T23:59:59Z"), ("ONLINE", "2026-01-01T00:09:00Z"),
                   ("OFFLINE", "2026-01-01T00:09:01Z")]  # fmt: skip
    last = entries.pop()
    for number, (state, moment) in enumerate(connections, start=1):
        payload = last["payload"] | {"headerId": number, "connectionState": state, "timestamp": moment}
        entries.append(last | {"payload": payload})
    assert [fault.sentence for fault in check_log(write_lines(tmp_path / "log.jsonl", entries)).faults] == []


def test_version_3_has_more_topics(log: Path, tmp_path: Path) -> None:
    entry = lines(log)[0]
    for level, faults in (("v2", 1), ("v3", 0)):
        topic = entry["topic"].replace("v2", level).replace("connection", "zoneSet")
        other = entry | {"topic": topic, "payload": {"version": f"{level[1]}.0.0"}}
        assert check_log(write_lines(tmp_path / "log.jsonl", [*lines(log), other])).total == faults


def test_repeated_broker_messages_are_no_fault(log: Path, tmp_path: Path) -> None:
    entries = lines(log)
    away, online = entries[-1] | {"retain": 1}, entries[0]
    kept = [away, online, online, *entries[1:]]  # a retained message, and one delivered twice, as QoS 1 allows
    found = check_log(write_lines(tmp_path / "log.jsonl", kept))
    assert (found.total, found.messages["connection"]) == (0, 2)


@pytest.mark.parametrize("vda", ["2", "3"])
def test_episode_round_trips_through_the_commands(vda: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    episode, folder = tmp_path / "e.npz", tmp_path / "fleet"
    driven().save(episode)
    assert main(["fleet", str(episode), "--out", str(folder), "--vda", vda]) == 0
    assert main(["fleet", "--check", str(folder)]) == 0
    assert "no faults" in capsys.readouterr().out
    command = ["fleet", "--listen", str(folder), "--map", str(folder / "floor.yaml")]
    assert main([*command, "--out", str(folder), "--json", str(tmp_path / "rows.jsonl")]) == 0
    (real,) = lines(tmp_path / "rows.jsonl")
    assert (real["policy"], real["robots"]) == ("fleet", 7)
    assert real["goals"] > 0
    assert real["reroutes"] is None
    assert len(real["vehicles"]) == 7
    page = tmp_path / "page.html"
    assert main(["replay", str(folder / "episode.npz"), "--html", str(page)]) == 0
    assert '"idle":"says nothing"' in page.read_text()
    assert "wrote the episode" in capsys.readouterr().out
    assert main(["audit", str(folder / "episode.npz"), "--out", str(tmp_path)]) == 2
    assert "cannot be run again" in capsys.readouterr().err


def test_fault_sets_the_exit_code(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = write_lines(tmp_path / "log.jsonl", [{"topic": "uagv/v2/A/1/state", "payload": {}}])
    assert main(["fleet", "--check", str(log), "--json", str(tmp_path / "c.jsonl")]) == 1
    assert "line 1, A/1: schema: in this state" in capsys.readouterr().out
    assert json.loads((tmp_path / "c.jsonl").read_text())["faults"] == 1
