"""Where a vehicle was, between its reports as well, by its positions and what it says of its connection."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from train.fleet.received import ASLEEP, GONE, Vehicle
from warehouse_env.maps.grid_map import GridMap

SILENCE = 30.0  # [s] after which a vehicle should have said something
_FASTEST, _STILL = 10.0, 1.0  # [m/s] and [m] beyond which a vehicle did not drive: it was carried, or found itself anew
LOST = (
    "was on another map", "was offline or cut off", "was moved while it hibernated",
    f"said nothing of its position for over {SILENCE:g} s", f"was farther than it drives at {_FASTEST:g} m/s",
)  # fmt: skip


class Places(NamedTuple):
    """Where one vehicle was, at moments of its own that go up."""

    seconds: NDArray[np.float64]  # [K], since 1970
    pose: NDArray[np.float64]  # [K, 3], in the floor's frame; headings go on beyond a turn
    lost: NDArray[np.int64]  # [K - 1], why nobody knows where it was between two of them, 1 + index of LOST; 0: known
    asleep: NDArray[np.bool_]  # [K - 1], where it hibernates in between
    until: float  # since 1970, when it was last there


class Clock(NamedTuple):
    """Even moments."""

    begin: float  # [s] since 1970
    step: float  # [s]
    frames: int

    @property
    def times(self) -> NDArray[np.float64]:
        """Seconds since the beginning."""
        return np.round(np.arange(self.frames) * self.step, 6)


def places_of(vehicle: Vehicle, name: str, grid: GridMap) -> Places:
    """Return where a vehicle was on a map; of two reports of one moment the later one."""
    order = np.argsort(np.frombuffer(vehicle.seconds), kind="stable")
    number = vehicle.maps.index(name) if name in vehicle.maps else -1
    there = np.frombuffer(vehicle.map, np.uint16)[order] == number
    seconds, x, y, theta = (
        np.frombuffer(values)[order][there] for values in (vehicle.seconds, vehicle.x, vehicle.y, vehicle.theta)
    )
    last = np.append(np.diff(seconds) > 0, True) if len(seconds) else np.zeros(0, np.bool_)
    pose = np.stack([x - grid.origin[0], y - grid.origin[1], np.unwrap(theta)], axis=-1)[last]
    elsewhere = np.diff(np.cumsum(~there)[there][last]) > 0
    seconds = seconds[last]
    asleep, gone = (_connected(vehicle, seconds, states) for states in ((ASLEEP,), GONE))
    gap, moved = np.diff(seconds), np.hypot(*np.diff(pose[:, :2], axis=0).T)
    why = (elsewhere, gone, asleep & (moved > _STILL), ~asleep & (gap > SILENCE + 1),
           moved > np.maximum(_FASTEST * gap, _STILL))  # fmt: skip
    until = _until(vehicle, float(seconds[-1])) if len(seconds) else 0.0
    return Places(seconds, pose, np.select(why, range(1, len(why) + 1)), asleep, until)


def _connected(vehicle: Vehicle, seconds: NDArray[np.float64], states: tuple[str, ...]) -> NDArray[np.bool_]:
    """Return bool[K - 1], between which of its reports a vehicle told one of these states of its connection."""
    found = np.zeros(len(seconds) + 1, np.bool_)
    found[np.searchsorted(seconds, [moment for moment, state in vehicle.connected if state in states], "right")] = True
    return found[1:-1]


def _until(vehicle: Vehicle, last: float) -> float:
    """Return when a vehicle was last there: at its last report, or up to the message that ends its hibernation."""
    asleep = False
    for moment, state in sorted(vehicle.connected, key=lambda one: one[0]):
        if asleep:
            return moment
        asleep = moment >= last and state == ASLEEP
    return np.inf if asleep else last


def spans(places: Places, which: NDArray[np.bool_], clock: Clock) -> Iterator[tuple[int, slice, int]]:
    """Yield the number of each of these gaps between reports, the frames in it, and the one that shows its end."""
    own, times = np.round(places.seconds - clock.begin, 6), clock.times
    for k in np.flatnonzero(which).tolist():
        start, stop = int(np.searchsorted(times, own[k], "right")), int(np.searchsorted(times, own[k + 1]))
        yield k, slice(start, stop), min(max(round(own[k + 1] / clock.step), start), stop)
