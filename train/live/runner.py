"""The thread of a live world; commands come from other threads."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from concurrent.futures import Future

from train.live.commands import Command
from train.live.drive import WorldDrive
from train.live.listeners import Listeners
from train.live.world import World
from warehouse_env.errors import ConfigError, WarehouseError

_LOOKS_EVERY = 0.5  # [s], whether it is stopped


class WorldRunner(threading.Thread):
    """Drives a world until `stop`; `listeners` receive it, and `ask` changes it.

    failed: the error that ended it, for the main thread to raise.
    """

    def __init__(self, make: Callable[[], World]) -> None:
        """make: makes the first world, within the thread, since kernels may be compiled."""
        super().__init__(name="live world", daemon=True)
        self.listeners = Listeners()
        self.drive: WorldDrive | None = None
        self.failed: BaseException | None = None
        self._make = make
        self._asked: queue.SimpleQueue[tuple[Command, Future[None]] | None] = queue.SimpleQueue()
        self._stopped = threading.Event()

    def ask(self, command: Command) -> None:
        """Carry out a command and wait for it; raises WarehouseError if it is refused."""
        answer: Future[None] = Future()
        self._asked.put((command, answer))
        while not self._stopped.is_set():
            try:
                return answer.result(_LOOKS_EVERY)
            except TimeoutError:
                continue
        raise ConfigError("the simulation has stopped")

    def look(self) -> None:
        """Wake the thread, for a new listener."""
        self._asked.put(None)

    def stop(self, timeout: float) -> None:
        """Stop, and wait for at most so long [s]: compiling cannot be interrupted."""
        self._stopped.set()
        self.look()
        self.join(timeout)

    def run(self) -> None:
        """Make the world and drive it."""
        try:
            self.drive = WorldDrive(self._make(), self.listeners)
            while not self._stopped.is_set():
                self._take(self.drive)
                self.drive.turn()
        except BaseException as error:
            self.failed = error
        finally:
            self._stopped.set()
            for listener in self.listeners.now():
                listener.close()

    def _take(self, drive: WorldDrive) -> None:
        """Wait until a step is due or a command comes, and answer the command."""
        wait = min(drive.due_in(), _LOOKS_EVERY)
        try:
            asked = self._asked.get(timeout=wait) if wait > 0 else self._asked.get_nowait()
        except queue.Empty:
            return
        if asked is None:
            return
        command, answer = asked
        try:
            drive.obey(command)
        except WarehouseError as error:
            answer.set_exception(error)
        else:
            answer.set_result(None)
