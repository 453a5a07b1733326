"""A queue of messages for each page, so that a slow page never holds up the world or another page."""

from __future__ import annotations

import contextlib
import queue
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from warehouse_env.errors import ConfigError

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
