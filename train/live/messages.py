"""Figures of a live world, and messages to pages: a header as JSON and arrays as in replay_codec.py, after a length.

Little-endian: uint32 bytes of the rest, uint32 bytes of the header, the header, the arrays. The header's `kind` is
`world` (everything that a page needs to begin), `moments` (which continue it) or `note` (the pace, and what is being
made). A message of length 0 only keeps the connection alive.

Each page has a queue of messages, so that a slow one never holds up the world or another page.
"""

import contextlib
import json
import queue
import struct
import threading
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from train.live.world import Moment, World
from warehouse_env.errors import ConfigError
from warehouse_env.render.pages import about_world
from warehouse_env.render.replay import FLAGS, Replay
from warehouse_env.render.replay_codec import Column, floor_columns, laid_out, moment_columns, route_columns

WINDOW = 120.0  # [s] over which goals an hour are counted
KEPT = 900  # samples, one a second
STANDS = 0.05  # [m/s] below which a robot stands
_ALIVE = 1 << FLAGS.index("alive")


class Sample(NamedTuple):
    """One second of a world; shares are means over its steps."""

    seconds: float  # since the world began
    goals_per_robot_hour: float  # over WINDOW, or since the beginning
    waiting: float  # share of the robots that wait for another
    standing: float  # share that stands
    contacts: int  # so far


class LiveFigures:
    """The samples of a world, `KEPT` at most."""

    def __init__(self) -> None:
        self.samples: deque[Sample] = deque(maxlen=KEPT)
        self._goals: deque[tuple[float, int]] = deque([(0.0, 0)])  # by second, over WINDOW
        self._shares: list[tuple[float, float]] = []

    def add(self, seconds: float, moment: dict[str, NDArray[Any]]) -> Sample | None:
        """Count a moment at `seconds` since the world began; return a sample if it completes a second."""
        alive = (moment["flags"] & _ALIVE) > 0
        many = max(int(alive.sum()), 1)
        waiting = int((alive & (moment["waits_for"] >= 0)).sum())
        standing = int((alive & (np.abs(moment["speed"]) < STANDS)).sum())
        self._shares.append((waiting / many, standing / many))
        last = self.samples[-1].seconds if self.samples else 0.0
        if seconds < int(last) + 1 - 1e-6:
            return None
        goals, contacts, _ = moment["totals"].tolist()
        self._goals.append((seconds, goals))
        while self._goals[1][0] <= seconds - WINDOW + 1e-6:
            self._goals.popleft()
        since, before = self._goals[0]
        rate = (goals - before) / len(alive) / max(seconds - since, 1e-6) * 3600.0
        waits, stands = np.mean(self._shares, axis=0).tolist()
        self._shares.clear()
        sample = Sample(round(seconds, 3), rate, waits, stands, contacts)
        self.samples.append(sample)
        return sample


ALIVE = struct.pack("<I", 0)
Routes = Mapping[int, NDArray[np.float32]]


def note(told: Mapping[str, Any]) -> bytes:
    """Return a message without arrays."""
    return _message({"kind": "note", **told}, ())


def whole(world: World, first: int, moment: Moment, routes: Routes, samples: Iterable[Sample]) -> bytes:
    """Return the message of a world at moment number `first`, with the robots' routes."""
    setting = world.setting
    about = about_world(setting.policy, world.grid, world.simulator.config, setting.seed)
    header = {
        "kind": "world", **about, "world": world.made, "floor": setting.floor, "policy": setting.policy,
        "seed": setting.seed, "seconds": world.step_seconds, "begin": world.seconds,
        **_moments(first, 1, routes, samples),
    }  # fmt: skip
    return _message(header, [*floor_columns(world.grid), *_columns(world, [moment], routes)])


def further(world: World, first: int, moments: Sequence[Moment], routes: Routes, samples: Iterable[Sample]) -> bytes:
    """Return the message of the moments from number `first` on, with routes that are new in them."""
    header = {"kind": "moments", **_moments(first, len(moments), routes, samples)}
    return _message(header, _columns(world, moments, routes))


def _moments(first: int, count: int, routes: Routes, samples: Iterable[Sample]) -> dict[str, Any]:
    return {"first": first, "count": count, "routes": list(routes), "samples": list(samples)}


def _columns(world: World, moments: Sequence[Moment], routes: Routes) -> list[Column]:
    arrays: dict[str, Any] = {name: np.stack([moment[name] for moment in moments]) for name in moments[0]}
    replay = Replay("", world.grid, world.simulator.config, world.setting.seed, routes=(), **arrays)
    return [*moment_columns(replay), *route_columns(list(routes.values()), world.grid)]


def _message(header: dict[str, Any], columns: Iterable[Column]) -> bytes:
    about, data = laid_out(columns)
    text = json.dumps({**header, "columns": about}, allow_nan=False, separators=(",", ":")).encode()
    return struct.pack("<II", 4 + len(text) + len(data), len(text)) + text + data


MOST = 8  # pages at a time
MOST_WAITING = 250  # messages, about ten seconds, that a page may be behind


class Listener:
    """One page's messages. It needs a whole world first, and again if it fell too far behind."""

    def __init__(self) -> None:
        self.needs_world = True
        self.closed = False
        self._messages: queue.Queue[bytes] = queue.Queue(MOST_WAITING)

    def put(self, message: bytes, world: bool = False) -> None:
        """Add a message; world: it is a whole world, which must come first."""
        if self.needs_world and not world:
            return
        self.needs_world = False
        try:
            self._messages.put_nowait(message)
        except queue.Full:
            self.renew()

    def renew(self) -> None:
        """Forget the waiting messages, since there is another world."""
        self._taken()
        self.needs_world = True

    def close(self) -> None:
        """Say that nothing more comes."""
        self.closed = True
        with contextlib.suppress(queue.Full):
            self._messages.put_nowait(b"")  # wakes `take`

    def take(self, timeout: float) -> bytes:
        """Return all waiting messages as one; none after `timeout` [s] without any."""
        try:
            first = self._messages.get(timeout=timeout) if timeout > 0 else b""
        except queue.Empty:
            return b""
        return first + self._taken()

    def _taken(self) -> bytes:
        found = []
        with contextlib.suppress(queue.Empty):
            while True:
                found.append(self._messages.get_nowait())
        return b"".join(found)


class Listeners:
    """All pages."""

    def __init__(self) -> None:
        self._all: list[Listener] = []
        self._lock = threading.Lock()

    @contextmanager
    def joined(self) -> Iterator[Listener]:
        """Yield a listener that hears everything from now on; ConfigError if there are too many."""
        listener = Listener()
        with self._lock:
            if len(self._all) >= MOST:
                raise ConfigError(f"{MOST} pages look already; close one of them")
            self._all.append(listener)
        try:
            yield listener
        finally:
            with self._lock:
                self._all.remove(listener)

    def now(self) -> list[Listener]:
        """Return the listeners."""
        with self._lock:
            return list(self._all)

    def put(self, message: bytes) -> None:
        """Send a message to all."""
        for listener in self.now():
            listener.put(message)
