"""What a shift comes to: time in service and in queues, and metres without a load."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


class Tally:
    """The sums of one world's shift, in seconds and metres of all its N robots together."""

    def __init__(self, count: int) -> None:
        self.waited = 0.0  # [s] for cells that others held
        self._served = self._at_stations = self._empty = 0.0  # [s], [s], [m]
        self._seen = np.zeros(count)  # [m] driven when this was last looked at

    def serve(self, seconds: float, at_station: bool) -> None:
        """Count a service that begins."""
        self._served += seconds
        self._at_stations += seconds if at_station else 0.0

    def drive(self, robot: int, driven: float, carried: bool) -> None:
        """Count what a robot has driven since the last time, up to `driven` [m] since the reset."""
        self._empty += 0.0 if carried else driven - self._seen[robot]
        self._seen[robot] = driven

    def row(
        self, now: float, driven: NDArray[np.float64], carries: NDArray[np.bool_],
        to_come: Sequence[tuple[float, bool]], waiting: float, stations: int,
    ) -> dict[str, float]:  # fmt: skip
        """Return the metrics after `now` [s].

        `served_share`, `queueing_share`: of the robots' time, in service and waiting for a cell that another holds;
        `station_utilisation`: of the stations' time, with a robot in service; `empty_driving`: of the metres driven,
        those without a load.

        driven [N] [m], carries bool[N]: now; to_come: of each service that goes on, the seconds to come and whether it
        is at one of the `stations`; waiting [s]: of those who wait, so far.
        """
        served = self._served - sum(seconds for seconds, _ in to_come)
        at_stations = self._at_stations - sum(seconds for seconds, at_station in to_come if at_station)
        empty = self._empty + float((driven - self._seen)[~carries].sum())
        time = now if now > 0 else math.nan
        return {
            "served_share": served / (len(driven) * time),
            "queueing_share": (self.waited + waiting) / (len(driven) * time),
            "station_utilisation": at_stations / (stations * time),
            "empty_driving": empty / float(driven.sum()) if driven.any() else math.nan,
        }
