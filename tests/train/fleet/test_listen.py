"""Test that messages become an episode: our own round-trips; foreign ones give all that their messages state."""

from __future__ import annotations

import cmath
import contextlib
import dataclasses
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.render.conftest import driven
from tests.train.fleet.stories import NAMES, ORIGIN, episode_story, story, write_lines
from train.fleet.build import episode_of
from train.fleet.driven import FleetEpisode, load_episode, load_simulated, row_of
from train.fleet.figures import AT_SHELF, MOMENT, PRESENT, SILENT, UNDER_WAY, FleetFigures
from train.fleet.messages import LogEntry, body_of, entry_of, factsheet_of, moment_of, write_log
from train.fleet.received import HeardFleet, hear_log
from train.fleet.vehicle import messages_of
from warehouse_env.config import EnvConfig, RobotSpec
from warehouse_env.errors import WarehouseError
from warehouse_env.maps.grid_map import GridMap
from warehouse_env.render.replay import FLAGS, replay_of
from warehouse_env.simulation.record.recording import Episode

FLOOR = GridMap(np.zeros((20, 20), np.bool_), name="hall", origin=ORIGIN)


def test_own_episode_round_trips(tmp_path: Path) -> None:
    episode = driven()
    write_log(messages_of(episode_story(), NAMES), tmp_path)
    back = episode_of(hear_log(tmp_path), episode.grid, EnvConfig())
    assert back.pose.shape == (*episode.pose.shape[:1], 1, *episode.pose.shape[2:])
    apart = (back.pose[:, 0] - episode.pose[:, 0]).astype(float)
    assert np.abs(apart[..., :2]).max() < 0.00051  # millimetres
    assert np.abs(np.remainder(apart[..., 2] + np.pi, 2 * np.pi) - np.pi).max() < 0.0002
    assert (back.config.robot, back.config.time_step) == (episode.config.robot, 0.2)
    *_, last = episode.replay()
    row, simulated = row_of(back, ""), last.episode_metrics(0)
    assert simulated["goals"] > 0
    for name in ("goals", "success_rate", "seconds", "collisions_robot", "collisions_person", "near_misses"):
        assert row[name] == pytest.approx(simulated[name]), name
    assert row["robot_km"] == pytest.approx(simulated["robot_km"], rel=0.02)  # chords, and corrections at contacts
    assert row["waiting_share"] == pytest.approx(simulated["waiting_share"], abs=0.05)
    assert min(simulated[name] for name in ("collisions_robot", "collisions_person", "near_misses")) > 0


def test_messages_on_a_turned_map_round_trip() -> None:
    """A yaw of 150 degrees turns positions and headings about the floor's corner and nothing else."""
    plain, angle = story(), math.radians(150)
    grid = dataclasses.replace(plain.replay.grid, yaw=angle)
    turned = plain._replace(replay=dataclasses.replace(plain.replay, grid=grid))
    both = [[message.payload for message in messages_of(one, NAMES)] for one in (plain, turned)]
    corner, ways = complex(*ORIGIN), []
    for old, new in zip(*map(places_in, both), strict=True):
        here, there = (complex(one["x"], one["y"]) - corner for one in (old, new))
        assert abs(here * cmath.exp(1j * angle) - there) < 0.0015  # both in whole millimetres
        ways.append(abs(here))
        if "theta" in old:
            assert abs(math.remainder(new["theta"] - old["theta"] - angle, math.tau)) < 0.0002
    assert max(ways) > 5
    assert [one.get("velocity") for one in both[0]] == [one.get("velocity") for one in both[1]]
    fleet = HeardFleet()
    for message in messages_of(turned, NAMES):
        entry = entry_of(message.line.encode())
        fleet.add(entry)
    back = episode_of(fleet, grid, EnvConfig())
    apart = back.pose[:, 0] - plain.replay.pose
    assert np.abs(apart[..., :2]).max() < 0.0011
    assert np.abs(np.sin(apart[..., 2])).max() < 0.0002
    assert back.lines[1][[0, -1]] == pytest.approx(np.array([(0.5, 0.5), (9.5, 0.5)]), abs=0.0011)


def places_in(payloads: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return all objects with x and y in messages, in order, without the factsheet's outlines."""
    found: list[dict[str, Any]] = []
    text = json.dumps([one for one in payloads if "agvGeometry" not in one])
    json.loads(text, object_hook=found.append)
    return [one for one in found if "x" in one]


def test_heard_episode_file_round_trips_and_replays(tmp_path: Path) -> None:
    write_log(messages_of(story(), NAMES), tmp_path)
    made = episode_of(hear_log(tmp_path), story().replay.grid, EnvConfig())
    made.save(tmp_path / "e.npz")
    back = load_episode(tmp_path / "e.npz")
    assert isinstance(back, FleetEpisode)
    np.testing.assert_array_equal(back.moments, made.moments)
    assert (back.vehicles, back.notes, back.begin) == (made.vehicles, made.notes, "2026-01-01T00:00:00.000+00:00")
    replay = replay_of(back, "real")
    np.testing.assert_array_equal(replay.pose, made.pose[:, 0])
    assert replay.goal[[0, 5, 10], 0].tolist() == [9 * 10 + 9, 44, 40]  # the ends of its routes
    assert replay.totals[-1].tolist() == [1, 0, 0]
    assert ((replay.flags >> 1) & 1)[:, 0].tolist() == [0] * 9 + [1] * 3
    assert replay.speed[1:, 0] == pytest.approx(np.ones(11))
    with pytest.raises(WarehouseError, match="cannot be run again"):
        load_simulated(tmp_path / "e.npz")
    driven().save(tmp_path / "s.npz")
    assert type(load_episode(tmp_path / "s.npz")) is Episode


def state_of(x: float, second: int, **more: Any) -> dict[str, Any]:
    """Return a minimal state of a foreign vehicle."""
    position = {"x": ORIGIN[0] + x, "y": ORIGIN[1] + 5.0, "theta": 0.0, "mapId": "L1", "positionInitialized": True}
    return {
        "headerId": second, "timestamp": f"2026-05-01T10:00:{second:02d}.5Z", "version": "2.0.0", "manufacturer": "M",
        "serialNumber": "a", "agvPosition": position, "orderId": "", "nodeStates": [], "edgeStates": [], **more,
    }  # fmt: skip


def entry(topic: str, payload: dict[str, Any], retain: int = 0) -> dict[str, Any]:
    """Return a log entry, as mosquitto_sub prints it."""
    return {"tst": "2026-05-01T10:00:00.5Z", "topic": topic, "qos": 0, "retain": retain, "payload": payload}


def hear(path: Path, messages: list[Any]) -> HeardFleet:
    """Write messages to a log and return the fleet heard from it; bare payloads get their vehicle's topic."""
    entries = [
        one if "payload" in one else entry(
            f"uagv/v2/M/{one.get('serialNumber', '')}/{'connection' if 'connectionState' in one else 'state'}", one
        )
        for one in messages
    ]  # fmt: skip
    return hear_log(write_lines(path / "f.jsonl", entries))


def test_minimal_foreign_states_give_an_episode(tmp_path: Path) -> None:
    node = {"nodeId": "n", "sequenceId": 2, "released": True, "nodePosition": {"x": 110.5, "y": -15, "mapId": "L1"}}
    on, done = {"orderId": "o", "nodeStates": [node], "edgeStates": [{}]}, {"orderId": "o"}
    states = [
        state_of(1, 0),
        state_of(1, 2, **on),
        state_of(3, 4, **on),
        state_of(4, 6, **done),
        state_of(4, 8, orderId="p"),
    ]
    made = episode_of(hear(tmp_path, states), FLOOR, EnvConfig())
    assert made.config.time_step == 2.0
    assert made.pose[:, 0, 0, 0].tolist() == [1, 1, 3, 4, 4]
    assert made.moments["goals"][:, 0].tolist() == [0, 0, 0, 1, 2]  # p was done between two states
    assert made.moments["goal"][1, 0] == 14 * 20 + 10
    assert made.moments["bits"][:, 0].tolist() == [PRESENT, *[PRESENT | UNDER_WAY] * 2, PRESENT, PRESENT]
    row = row_of(made, "")
    assert (row["robot_km"], row["goals"], row["path_length_m"]) == (0.003, 2.0, 1.5)
    assert row["waiting_share"] == 0.5  # it stood in one of two moments with an order


def test_poses_between_reports_are_interpolated(tmp_path: Path) -> None:
    made = episode_of(hear(tmp_path, [at(1, 0, theta=3.0), at(3, 4, theta=-3.0)]), FLOOR, EnvConfig(), every=1.0)
    assert made.pose[:, 0, 0, 0].tolist() == [1, 1.5, 2, 2.5, 3]
    assert np.abs(made.pose[1:4, 0, 0, 2]).min() > 3.0  # the short way round, through pi


def version_3(x: float, second: int) -> dict[str, Any]:
    """Return a state in terms of VDA 5050 3.0."""
    state = state_of(x, second, version="3.0.0")
    position = state.pop("agvPosition")
    return state | {"mobileRobotPosition": position | {"localized": position.pop("positionInitialized")}}


def unnamed(x: float, second: int) -> dict[str, Any]:
    """Return a state that does not name its vehicle."""
    return {name: value for name, value in state_of(x, second).items() if name not in ("manufacturer", "serialNumber")}


def at(x: float, second: int, **more: Any) -> dict[str, Any]:
    """Return a state with a changed position entry."""
    state = state_of(x, second)
    return state | {"agvPosition": state["agvPosition"] | more}


OLD = state_of(9, 0, timestamp="2026-04-01T10:00:00Z")
EMPTY = [
    "orderId", "orderUpdateId", "nodeStates", "edgeStates", "actionStates", "loads", "errors", "version", "headerId",
]  # fmt: skip
STREAMS = {
    "version 1.1": [entry("uagv/v1/M/a/state", state_of(x, x, version="1.1.0", lastNodeId="")) for x in (1, 2, 3)],
    "version 3": [entry("uagv/v3/M/a/state", version_3(x, x)) for x in (1, 2, 3)],
    "deeper topics": [entry("plant/hall/uagv/v2/M/a/state", unnamed(x, x)) for x in (1, 2, 3)],
    "short topics": [entry("7/state", state_of(x, x)) for x in (1, 2, 3)],
    "odd versions": [state_of(x, x, version=odd) for x, odd in ((1, "2"), (2, "v2.1.0"), (3, None))],
    "nothing but a position": [state_of(x, x) | dict.fromkeys(EMPTY) for x in (1, 2, 3)],
    "twice": [state_of(x, x) for x in (1, 1, 2, 2, 3, 3)],
    "out of order": [state_of(x, x) for x in (2, 1, 3)],
    "kept from before": [entry("uagv/v2/M/a/state", OLD, 1), *(state_of(x, x) for x in (1, 2, 3))],
    "not yet located": [
        at(9, 0, positionInitialized=False), at(9, 0, positionInitialized=None, localized=False),
        *(state_of(x, x) for x in (1, 2, 3)),
    ],
    "zones": [
        state_of(1, 0, timestamp="2026-05-01T12:00:01.500000000+02:00"),
        state_of(2, 0, timestamp="2026-05-01T10:00:02,5z"),
        state_of(3, 0, timestamp="2026-05-01T10:00:03.5"),
    ],
}  # fmt: skip


@pytest.mark.parametrize("stream", STREAMS)
def test_streams_of_other_vendors_are_read(stream: str, tmp_path: Path) -> None:
    made = episode_of(hear(tmp_path, STREAMS[stream]), FLOOR, EnvConfig())
    assert made.pose[:, 0, 0, 0].tolist() == [1, 2, 3]
    assert made.vehicles == ("M/a",)
    assert made.begin == "2026-05-01T10:00:01.500+00:00"


def link(state: Any, second: int) -> dict[str, Any]:
    """Return a connection message."""
    header = ("headerId", "timestamp", "version", "manufacturer", "serialNumber")
    return {name: value for name, value in state_of(0, second).items() if name in header} | {"connectionState": state}


AWAY = {
    "on another map": [state_of(1, 0), state_of(2, 2), at(9, 4, mapId="L2"), state_of(8, 6), state_of(9, 8)],
    "offline": [state_of(1, 0), state_of(2, 2), link("OFFLINE", 3), link("ONLINE", 5), state_of(8, 6), state_of(9, 8)],
    "offline, out of order": [link("OFFLINE", 3), state_of(8, 6), state_of(1, 0), state_of(9, 8), state_of(2, 2)],
    "cut off, by a will as old as the connection": [
        link("ONLINE", 0), state_of(1, 0), state_of(2, 2), link("CONNECTIONBROKEN", 0), state_of(8, 6), state_of(9, 8)],
    "cut off, as version 3 says it": [state_of(1, 0), state_of(2, 2), link("CONNECTION_BROKEN", 0), state_of(8, 6),
                                      state_of(9, 8)],
    "silent": [link("ONLINE", 0), state_of(1, 0), state_of(2, 2), state_of(8, 50), state_of(9, 52)],
    "carried": [state_of(1, 0), state_of(2, 2), at(0, 6, y=ORIGIN[1] + 60), state_of(8, 8)],
}  # fmt: skip


SILENCES = {
    "cut off, by a will as old as the connection": "6.0 s: its connection broke",
    "cut off, as version 3 says it": "6.0 s: its connection broke", "silent": "50.0 s: no message",
}  # fmt: skip


@pytest.mark.parametrize("how", AWAY)
def test_vehicle_that_reappears_elsewhere_was_absent(how: str, tmp_path: Path) -> None:
    made = episode_of(hear(tmp_path, AWAY[how]), FLOOR, EnvConfig(), every=2.0)
    present = (made.moments["bits"] & PRESENT) != 0
    frames = sorted(one["headerId"] // 2 for one in AWAY[how] if one.get("agvPosition", {}).get("mapId") == "L1")
    seen = frames if how != "carried" else [0, 1, 4]  # between two messages
    assert np.flatnonzero(present[:, 0]).tolist() == seen
    assert row_of(made, "")["robot_km"] == pytest.approx(0.002 - 0.001 * (how == "carried"))
    assert row_of(made, "")["longest_standing_s"] < 5
    assert any("absent" in note for note in made.notes)
    silence = [note for note in made.notes if "is silent" in note]
    assert silence == ([f"M/a is silent from 2.0 s to {SILENCES[how]}"] if how in SILENCES else [])
    assert np.array_equal((made.moments["bits"] & SILENT) > 0, ~present & (how in SILENCES))


@pytest.mark.parametrize("every", [0.7, 5.0])
def test_moments_do_not_bridge_a_gap(every: float, tmp_path: Path) -> None:
    states = [state_of(1, 0), state_of(1, 7), link("OFFLINE", 7), state_of(15, 8), state_of(15, 20)]
    made = episode_of(hear(tmp_path, states), FLOOR, EnvConfig(), every=every)
    assert row_of(made, "")["robot_km"] == 0
    assert set(made.pose[:, 0, 0, 0].tolist()) == {1.0, 15.0}


def test_silent_vehicles_are_noted(tmp_path: Path) -> None:
    states = [state_of(1, 0), state_of(1, 1), state_of(1, 0, serialNumber="b"), state_of(1, 59, serialNumber="b")]
    made = episode_of(hear(tmp_path, states), FLOOR, EnvConfig(), every=1.0)
    assert np.flatnonzero(made.moments["bits"][:, 0] & PRESENT).tolist() == [0, 1]
    assert "M/a is silent from 1.0 s on: no message" in made.notes
    assert "M/b is silent from 0.0 s to 59.0 s: no message" in made.notes
    assert any("1 time the place of a vehicle is unknown" in note for note in made.notes)
    assert np.flatnonzero(made.moments["bits"][:, 0] & SILENT).tolist() == list(range(2, 60))
    assert np.flatnonzero(made.moments["bits"][:, 1] & SILENT).tolist() == list(range(1, 59))
    replay = replay_of(made, "real")
    assert np.array_equal((replay.flags >> FLAGS.index("silent")) & 1 > 0, (made.moments["bits"] & SILENT) > 0)


def test_final_last_will_is_a_silence(tmp_path: Path) -> None:
    wills = [link("CONNECTIONBROKEN", 0) | {"serialNumber": f"{k:02d}"} for k in range(12)]
    states = [state_of(1, second, serialNumber=f"{k:02d}") for second in (0, 4) for k in range(12)]
    notes = episode_of(hear(tmp_path, [*states, *wills]), FLOOR, EnvConfig()).notes
    silent = [one for one in notes if "silence" in one or "silent" in one]
    assert silent[0] == "M/00 is silent from 4.0 s on: its connection broke"
    assert silent[10:] == ["2 more silences of vehicles"]


def test_vda_versions_are_noted(tmp_path: Path) -> None:
    new = [version_3(x, x) for x in (1, 2, 3)]
    made = episode_of(hear(tmp_path, new), FLOOR, EnvConfig())
    assert any("3 messages are of version 3 of VDA 5050" in note for note in made.notes)
    later = [state_of(9, x, version=f"4.{x}.0") for x in (1, 2)]
    made = episode_of(hear(tmp_path, [*later, state_of(1, 0), state_of(2, 3)]), FLOOR, EnvConfig())
    assert made.notes[0].startswith("2 messages or lines are of version 4 of VDA 5050 (versions 1 to 3 are read)")
    with pytest.raises(WarehouseError, match=r"none says where a vehicle is.*version 4"):
        episode_of(hear(tmp_path, later), FLOOR, EnvConfig())


@pytest.mark.parametrize(
    ("states", "note_part"),
    [
        ([], "none says where"),
        ([state_of(1, 0)], "less than"),
        ([state_of(1e5, 0), state_of(1e5, 5)], "no position lies on the floor"),
        ([state_of(1, 0), state_of(1, 1), state_of(1, 2, timestamp="9000-01-01T00:00:00Z")], "cut the log"),
    ],
)
def test_logs_too_short_or_too_long_are_refused(states: list[Any], note_part: str, tmp_path: Path) -> None:
    with pytest.raises(WarehouseError, match=note_part):
        episode_of(hear(tmp_path, states), FLOOR, EnvConfig())


def test_skipped_messages_are_noted(tmp_path: Path) -> None:
    lost = state_of(1, 3, serialNumber="b", agvPosition=None)
    other = state_of(9, 1)
    other["agvPosition"] = other["agvPosition"] | {"mapId": "L2"}
    lines = [state_of(1, 0), state_of(99, 1), other, state_of(2, 2), lost, {"x": 1}, {**state_of(3, 3), "timestamp": 7}]
    lines.append(link("SLEEPING", 3))
    made = episode_of(hear(tmp_path, lines), FLOOR, EnvConfig())
    notes = "; ".join(made.notes)
    for note_part in (
        "no topic or", "no timestamp", "1 position on other maps", "1 vehicle never said", "off the floor",
        "another connectionState",
    ):  # fmt: skip
        assert note_part in notes, notes


def test_footprints_come_from_factsheets() -> None:
    robot = RobotSpec(length=1.4, width=0.8, front_overhang=1.1)
    assert RobotSpec(**body_of(factsheet_of(EnvConfig(robot=robot), 1.0))[0]) == RobotSpec(
        length=1.4, width=0.8, front_overhang=1.1)  # fmt: skip
    assert body_of({"physicalParameters": {"length": 2, "width": 1.0}})[0]["front_overhang"] == 1.0
    assert body_of({"physicalParameters": {"length": "x"}})[0] == {}


def test_near_misses_and_contacts_count_once_each() -> None:
    figures = FleetFigures(EnvConfig(num_agents=2, time_step=1.0))
    # two robots of 0.9 m in a row: two near misses, then an overlap; the second robot touches a shelf twice
    gaps, shelf = (1.0, 0.05, 1.0, 0.05, 1.0, -0.1, 0.05, 1.0), (0, 1, 1, 0, 0, 1, 0, 0)
    for gap, touches in zip(gaps, shelf, strict=True):
        moment = np.zeros(2, MOMENT)
        moment["bits"] = PRESENT | UNDER_WAY
        moment["bits"][1] |= AT_SHELF * touches
        figures.take(np.array([[1.0, 1.0, 0.0], [1.9 + gap, 1.0, 0.0]], np.float32), moment)
    totals = figures.robots[0]["totals"]
    assert totals["near_misses"].tolist() == [2, 2]
    assert totals["hits_robot"].tolist() == [1, 1]
    assert totals["hits_shelf"].tolist() == [0, 2]
    assert totals["distance"].tolist() == pytest.approx([0.0, 0.95 * 4 + 1.1 + 0.15 + 0.95], abs=1e-5)
    assert totals["waited"].tolist() == [7, 0]
    assert totals["longest_standing"][0] == 7.0


def test_timestamps_are_parsed() -> None:
    assert moment_of("2026-01-01T00:00:00.12Z") == moment_of("2026-01-01T01:00:00.120+01:00") == 1767225600.12
    assert moment_of("2026-01-01T00:00:00") == 1767225600
    assert moment_of("2026-01-01T00:00:00", zoned=True) is None
    assert moment_of("2026-01-01t00:00:00.123456789z", zoned=True) == 1767225600.123456


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3)
    | st.dictionaries(st.sampled_from(["x", "nodePosition", "mapId", "errorType", "a"]), inner, max_size=3),
    max_leaves=8,
)  # fmt: skip


@settings(max_examples=60, deadline=None)
@given(st.dictionaries(st.sampled_from([*sorted(state_of(0, 0)), "loads", "errors", "actionStates"]), JSON, max_size=4),
       st.sampled_from(["uagv/v2/M/a/state", "uagv/v2/M/a/factsheet", "a//b", "uagv/v2/M/b/visualization"]),
       st.binary(max_size=40))  # fmt: skip
def test_any_message_is_accepted_or_refused(changes: dict[str, Any], topic: str, junk: bytes) -> None:
    fleet = HeardFleet()
    for second in range(3):
        fleet.add(LogEntry("uagv/v2/M/a/state", state_of(second, second), None, None))
    fleet.add(entry_of(json.dumps(entry(topic, {**state_of(1, 1), **changes})).encode()))
    fleet.add(entry_of(junk))
    with contextlib.suppress(WarehouseError):
        made = episode_of(fleet, FLOOR, EnvConfig())
        assert np.isfinite(made.pose).all()
        assert row_of(made, "")["robot_km"] >= 0
