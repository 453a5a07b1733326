"""The track of a vehicle, also between its reports, from its positions and connection messages."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from train.fleet.received import GONE, HeardVehicle
from warehouse_env.maps.grid_map import GridMap

SILENCE = 30.0  # [s] after which a vehicle should have said something
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
    pose = np.stack([x - grid.origin[0], y - grid.origin[1], np.unwrap(theta)], axis=-1)[last]
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
