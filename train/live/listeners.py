"""Who looks: a queue of messages for each page, so that a slow one never holds up the world or another page."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager

from warehouse_env.errors import ConfigError

MOST = 8  # pages at a time
MOST_WAITING = 4_000_000  # bytes that a page may be behind


class Listener:
    """One page's messages. It needs a whole world first, and again once it was too far behind."""

    def __init__(self) -> None:
        self.needs_world = True
        self.closed = False
        self._messages: deque[bytes] = deque()
        self._bytes = 0
        self._changed = threading.Condition()

    def put(self, message: bytes, world: bool = False) -> None:
        """Add a message; world: it is a whole world, before which nothing else is of use."""
        with self._changed:
            if self.needs_world and not world:
                return
            self.needs_world = False
            if self._bytes + len(message) > MOST_WAITING and self._messages:
                self._forget()
                return
            self._messages.append(message)
            self._bytes += len(message)
            self._changed.notify()

    def renew(self) -> None:
        """Forget what waits, for there is another world."""
        with self._changed:
            self._forget()

    def _forget(self) -> None:
        self._messages.clear()
        self._bytes, self.needs_world = 0, True

    def close(self) -> None:
        """Say that nothing more comes."""
        with self._changed:
            self.closed = True
            self._changed.notify()

    def take(self, timeout: float) -> bytes:
        """Return all messages that wait, as one; none after `timeout` [s] without any."""
        with self._changed:
            self._changed.wait_for(lambda: self._messages or self.closed, timeout)
            taken = b"".join(self._messages)
            self._messages.clear()
            self._bytes = 0
            return taken


class Listeners:
    """All pages that look."""

    def __init__(self) -> None:
        self._all: list[Listener] = []
        self._lock = threading.Lock()

    @contextmanager
    def joined(self) -> Iterator[Listener]:
        """Yield a listener that hears all until the end; ConfigError where too many look."""
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

    def put(self, message: bytes) -> None:
        """Give all a message."""
        for listener in self._now():
            listener.put(message)

    def renew(self) -> None:
        """Have all begin with the whole of another world."""
        for listener in self._now():
            listener.renew()

    def waiting(self) -> list[Listener]:
        """Return those who need a whole world."""
        return [listener for listener in self._now() if listener.needs_world]

    def close(self) -> None:
        """Tell all that nothing more comes."""
        for listener in self._now():
            listener.close()

    def _now(self) -> list[Listener]:
        with self._lock:
            return list(self._all)
