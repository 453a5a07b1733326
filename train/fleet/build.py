"""Turn the messages of vehicles into an episode: all vehicles on one floor at even moments."""

from __future__ import annotations

import bisect
import dataclasses
from collections import Counter
from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from train.fleet.driven import MOST_POINTS, FleetEpisode
from train.fleet.figures import MOMENT, PRESENT, SILENT, UNDER_WAY
from train.fleet.messages import body_of
from train.fleet.received import GONE, HeardFleet, HeardVehicle, Key
from train.fleet.silence import SILENCE, silences_notes, silences_of, within
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError, WarehouseError, counted, shown
from warehouse_env.maps.grid_map import GridMap

FINEST = 0.05  # [s] between two moments, unless asked for
_COARSEST = 10.0  # [s]
_MOST, _LONGEST = 5_000_000, 200_000  # moments of all vehicles; of one


def episode_of(fleet: HeardFleet, grid: GridMap, config: EnvConfig, every: float | None = None) -> FleetEpisode:
    """Return the episode of a fleet's messages; config: names the floor.

    every: seconds between two moments (None: as often as vehicles report). Raises WarehouseError if there are too few
    positions, or too long a time.
    """
    name, elsewhere = _map_of(fleet, grid)
    found = {key: places_of(vehicle, name, grid) for key, vehicle in sorted(fleet.vehicles.items())}
    placed = {key: places for key, places in found.items() if len(places.seconds)}
    notes = [*_messages_notes(fleet), *elsewhere]
    if not placed:
        why = "".join(f"; {note}" for note in notes)
        raise WarehouseError(f"{counted(fleet.messages, 'message')} came, and none says where a vehicle is{why}")
    if len(placed) < len(found):
        notes.append(f"{counted(len(found) - len(placed), 'vehicle')} never said where: left out")
    clock = _clock(placed, every)
    pose = np.zeros((clock.frames, 1, len(placed), 3), np.float32)
    moments = np.zeros((clock.frames, len(placed)), MOMENT)
    works = any(told.works for vehicle in fleet.vehicles.values() for told in vehicle.told)
    lines: list[NDArray[np.float32]] = []
    end = max(float(places.seconds[-1]) for places in placed.values())
    silences = {key: silences_of(fleet.vehicles[key], clock.begin, end) for key in placed}
    for k, (key, places) in enumerate(placed.items()):
        pose[:, 0, k] = _at(places, clock)
        moments[:, k] = _Timeline(fleet.vehicles[key], places, grid, clock, works).moments(pose[:, 0, k], lines)
        absent = (moments["bits"][:, k] & PRESENT) == 0
        moments["bits"][:, k] |= np.uint8(SILENT) * (absent & within(silences[key], clock.times))
    if sum(map(len, lines)) > MOST_POINTS:
        raise WarehouseError(f"the orders in these messages have more than {MOST_POINTS:,} nodes; cut the log")
    config, bodies = _config(fleet, list(placed), config, clock)
    notes += [*_places_notes(placed, grid), *_absences_notes(placed), *silences_notes(silences), *bodies]
    stamp = datetime.fromtimestamp(clock.begin, UTC).isoformat(timespec="milliseconds")
    actions = np.zeros((clock.frames - 1, 1, len(placed)), np.int8)
    names = tuple("/".join(key) for key in placed)
    return FleetEpisode(config, grid, (0,), actions, pose, "", None, moments, tuple(lines), names, stamp, tuple(notes))


def _messages_notes(fleet: HeardFleet) -> list[str]:
    """Return notes on messages that were left out, or are of another version."""
    notes = [f"{count:,} messages or lines {why}: left out" for why, count in sorted(fleet.left_out.items())]
    notes += [
        f"{counted(count, 'message')} are of version {major} of VDA 5050; what version 2.1 does not have is not shown"
        for major, count in sorted(fleet.versions.items())
        if major != 2
    ]
    return notes


def _map_of(fleet: HeardFleet, grid: GridMap) -> tuple[str, list[str]]:
    """Return the map whose positions are used, the floor's own name or the most frequent one, and notes on it."""
    count: Counter[str] = Counter()
    for vehicle in fleet.vehicles.values():
        numbers = vehicle.reports[:, 4]
        count.update({each: int((numbers == number).sum()) for each, number in vehicle.maps.items()})
    name = grid.name if grid.name in count or not count else count.most_common(1)[0][0]
    others, notes = sum(count.values()) - count[name], []
    if others:
        notes.append(f"{counted(others, 'position')} on other maps than {shown(name)}: left out")
    if name not in ("", grid.name):
        notes.append(f"positions are on the map {shown(name)}, taken for the floor {shown(grid.name)}")
    return name, notes


def _clock(placed: dict[Key, Track], every: float | None) -> EvenTimes:
    """Return the episode's moments."""
    begin = min(float(places.seconds[0]) for places in placed.values())
    end = max(float(places.seconds[-1]) for places in placed.values())
    gaps = [float(np.median(np.diff(places.seconds))) for places in placed.values() if len(places.seconds) > 1]
    step = every if every is not None else min(max(round(float(np.median(gaps or [1.0])), 3), FINEST), _COARSEST)
    if not FINEST / 50 <= step <= _COARSEST:
        raise ConfigError(f"--every {step:g} must be from {FINEST / 50:g} to {_COARSEST:g} [s]")
    frames = int((end - begin) / step + 1e-3) + 1
    if frames < 2:
        raise WarehouseError(f"these messages are of {end - begin:g} s, less than the {step:g} s between two moments")
    if frames > _LONGEST or frames * len(placed) > _MOST:
        first, last = (datetime.fromtimestamp(one, UTC).isoformat(timespec="seconds") for one in (begin, end))
        raise WarehouseError(
            f"these messages go from {first} to {last}, {frames:,} moments of {step:g} s for "
            f"{counted(len(placed), 'vehicle')}; cut the log, or name more seconds with --every"
        )
    return EvenTimes(begin, step, frames)


def _at(places: Track, clock: EvenTimes) -> NDArray[np.float64]:
    """Return float64[F, 3], the poses at even moments: interpolated between reports, except where it is unknown."""
    own = np.round(places.seconds - clock.begin, 6)
    pose = np.stack([np.interp(clock.times, own, places.pose[:, axis]) for axis in range(3)], axis=-1)
    for k, inside, back in spans(places, clock):
        pose[inside.start : back] = places.pose[k]
        pose[back : inside.stop] = places.pose[k + 1]
    pose[:, 2] = np.remainder(pose[:, 2] + np.pi, 2 * np.pi) - np.pi
    return pose


class _Timeline:
    """The orders of one vehicle at even moments."""

    def __init__(self, vehicle: HeardVehicle, places: Track, grid: GridMap, clock: EvenTimes, works: bool) -> None:
        """works: only orders with an action count as goals, since some vehicle reports actions."""
        self._told = sorted(vehicle.told, key=lambda told: told.seconds)
        self._places, self._grid, self._clock, self._works = places, grid, clock, works
        self._mute = not any(told.order for told in vehicle.told)  # no orders: it counts as always under way

    def moments(self, pose: NDArray[np.float32], lines: list[NDArray[np.float32]]) -> NDArray[Any]:
        """Return MOMENT[F]; append the lines of its orders."""
        times = self._clock.times
        out = np.zeros(len(times), MOMENT)
        lines.append(pose[:1, :2].copy())
        now = np.zeros((), MOMENT)
        now["line"], now["goal"] = len(lines) - 1, self._cell(pose[0, :2])
        now["bits"] = UNDER_WAY * self._mute
        order, done, planned = "", True, 0.0
        at = 0
        for number, told in enumerate(self._told):
            frame = bisect.bisect_left(times, round(told.seconds - self._clock.begin, 6) - 1e-6)
            out[at:frame] = now
            at = frame
            if told.nodes:
                lines.append(self._line(told.nodes, pose[min(frame, len(pose) - 1), :2]))
                now["line"], now["goal"] = len(lines) - 1, self._cell(lines[-1][-1])
            if told.order != order:  # an order that is done when first seen was done since the last state
                order, done, planned = told.order, not told.order or (number == 0 and not told.left), 0.0
            if told.nodes and not planned:  # as it was first given
                planned = float(np.hypot(*np.diff(lines[-1], axis=0).T).sum())
            if not done and not told.left:
                done = True
                if told.works or not self._works:
                    now["goals"] += 1
                    now["planned"] += planned
            now["bits"] = told.bits | UNDER_WAY * (self._mute or told.left > 0)
        out[at:] = now
        out["bits"][times > self._places.seconds[-1] - self._clock.begin + self._clock.step / 2] &= ~np.uint8(UNDER_WAY)
        out["bits"] |= PRESENT * self._present(times).astype(np.uint8)
        return out

    def _present(self, times: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return bool[F]: whether the vehicle's place is known."""
        first, until = self._places.seconds[[0, -1]] - self._clock.begin
        half = self._clock.step / 2
        found = (times >= first - half) & (times <= until + half)
        for k, _, back in spans(self._places, self._clock):
            left = round((self._places.seconds[k] - self._clock.begin) / self._clock.step) + 1
            found[max(min(left, back - 1), 0) : back] = False
        return np.asarray(found)

    def _line(self, nodes: tuple[tuple[float, float], ...], here: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the line from the vehicle over the nodes to come."""
        return np.concatenate([[here], self._grid.local(nodes)]).astype(np.float32)

    def _cell(self, point: NDArray[np.float32]) -> int:
        """Return the number of the cell nearest to a point."""
        row, column = self._grid.nearest_cell(point).tolist()
        return int(row * self._grid.shape[1] + column)


def _places_notes(placed: dict[Key, Track], grid: GridMap) -> list[str]:
    """Return notes on positions that are impossible on this floor; WarehouseError if none lies on it."""
    side = np.array(grid.shape[::-1]) * grid.cell_size
    poses = np.concatenate([places.pose[:, :2] for places in placed.values()])
    on = np.asarray(((poses >= 0) & (poses < side)).all(axis=1))
    if not on.any():
        low, high = (np.round(grid.world(corner), 1).tolist() for corner in (poses.min(axis=0), poses.max(axis=0)))
        floor = [np.round(grid.world(corner), 1).tolist() for corner in (np.zeros(2), side)]
        raise WarehouseError(
            f"no position lies on the floor: they are from {low} to {high} m, the floor from {floor[0]} to {floor[1]}; "
            "is --map or --layout another one, or its origin?"
        )
    in_shelves = int(grid.occupied[tuple(grid.nearest_cell(poses[on]).T)].sum())
    found = ((int((~on).sum()), "off the floor"), (in_shelves, "in cells of shelves or walls"))
    return [f"{counted(count, 'position')} of {len(on):,} lie {where}" for count, where in found if count]


def _absences_notes(placed: dict[Key, Track]) -> list[str]:
    """Return a note on how often vehicles were absent."""
    absent = sum(int(places.lost.sum()) for places in placed.values())
    why = "the place of a vehicle is unknown (offline, silent, carried or on another map): it is absent"
    return [f"{counted(absent, 'time')} {why}"] if absent else []


def _config(fleet: HeardFleet, keys: list[Key], config: EnvConfig, clock: EvenTimes) -> tuple[EnvConfig, list[str]]:
    """Return the config of the episode, with the body of the first factsheet, and notes on that body."""
    bodies = [body_of(fleet.vehicles[key].factsheet) for key in keys]
    body, how = bodies[0]
    notes = [f"the vehicles' bodies: {how}"]
    if any(other != body for other, _ in bodies):
        notes.append("the vehicles differ in size; all are taken for the first one's")
    robot = dataclasses.replace(config.robot, **body)
    made = config.replace(num_agents=len(keys), time_step=clock.step, max_steps=clock.frames - 1, robot=robot)
    return made, notes


_FASTEST, _STILL = 10.0, 1.0  # [m/s] and [m] beyond which a vehicle was not driven: carried, or relocalized


class Track(NamedTuple):
    """Where one vehicle was, at increasing moments of its own."""

    seconds: NDArray[np.float64]  # [K], since 1970
    pose: NDArray[np.float64]  # [K, 3], in the floor's frame; headings are unwrapped
    lost: NDArray[np.bool_]  # [K - 1], whether its place between two of them is unknown


class EvenTimes(NamedTuple):
    """Even moments."""

    begin: float  # [s] since 1970
    step: float  # [s]
    frames: int

    @property
    def times(self) -> NDArray[np.float64]:
        """Seconds since the beginning."""
        return np.round(np.arange(self.frames) * self.step, 6)


def places_of(vehicle: HeardVehicle, name: str, grid: GridMap) -> Track:
    """Return where a vehicle was on a map; of two reports of one moment the later one."""
    reports = vehicle.reports
    reports = reports[np.argsort(reports[:, 0], kind="stable")]
    there = reports[:, 4] == vehicle.maps.get(name, -1)
    seconds, x, y, theta = reports[there, :4].T
    last = np.append(np.diff(seconds) > 0, True)[: len(seconds)]
    pose = np.column_stack([grid.local(np.stack([x, y], axis=-1)), np.unwrap(theta) - grid.yaw])[last]
    elsewhere = np.diff(np.cumsum(~there)[there][last]) > 0
    seconds = seconds[last]
    gap, moved = np.diff(seconds), np.hypot(*np.diff(pose[:, :2], axis=0).T)
    far = moved > np.maximum(_FASTEST * gap, _STILL)
    return Track(seconds, pose, elsewhere | _gone(vehicle, seconds) | (gap > SILENCE + 1) | far)


def _gone(vehicle: HeardVehicle, seconds: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return bool[K - 1]: between which of its reports a vehicle went offline."""
    found = np.zeros(len(seconds) + 1, np.bool_)
    found[np.searchsorted(seconds, [moment for moment, state in vehicle.connected if state in GONE], "right")] = True
    return found[1:-1]


def spans(places: Track, clock: EvenTimes) -> Iterator[tuple[int, slice, int]]:
    """Yield each gap in which the place is unknown: its number, the frames in it, the frame that shows its end."""
    own, times = np.round(places.seconds - clock.begin, 6), clock.times
    for k in np.flatnonzero(places.lost).tolist():
        start, stop = int(np.searchsorted(times, own[k], "right")), int(np.searchsorted(times, own[k + 1]))
        yield k, slice(start, stop), min(max(round(own[k + 1] / clock.step), start), stop)
