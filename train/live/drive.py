"""Drive a live world: step it at a pace, carry out commands, and send what happens to all pages."""

import queue
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

from train.live.messages import Listeners, LiveFigures, Sample, further, note, whole
from train.live.world import Command, Make, Moment, Play, Speed, Step, World
from warehouse_env.errors import ConfigError, WarehouseError
from warehouse_env.render.replay import Lines

TELLS_EVERY = 0.04  # [s] between two messages to pages
MOST_MOMENTS = 250  # in a message
MAKING = "Building the world. New kernels compile once, for about a minute."
_LATE = 0.25  # [s] behind the pace after which the pace restarts
_IDLE = 0.5  # [s] between two turns while paused


class WorldDrive:
    """Steps a world when a step is due, and sends what happens to listeners."""

    def __init__(self, world: World, listeners: Listeners) -> None:
        self.world, self._listeners = world, listeners
        self._playing = True
        self._speed: float | None = 1.0
        self._first = 0  # number of the last moment sent
        self._told_at = 0.0
        self._show()

    def due_in(self) -> float:
        """Return in how many seconds a step is due, 0 or less if it is now."""
        if not self._playing:
            return _IDLE
        if self._speed is None:
            return 0.0
        due = self._since + (self.world.steps - self._since_steps) * self.world.step_seconds / self._speed
        return due - time.perf_counter()

    def turn(self) -> None:
        """Step if it is due, and send pages what is new."""
        if self._playing and self.due_in() <= 0:
            self._step()
        now = time.perf_counter()
        if now - self._told_at >= TELLS_EVERY or len(self._moments) >= MOST_MOMENTS or self.due_in() > TELLS_EVERY:
            self._tell(now)
        if waiting := [listener for listener in self._listeners.now() if listener.needs_world]:
            self._tell(now)
            for listener in waiting:
                listener.put(self._whole(), world=True)
                listener.put(note(self._pace()))

    def obey(self, command: Command) -> None:
        """Carry out a command; raises WarehouseError if it is refused."""
        if isinstance(command, Play):
            self._play(command.playing)
        elif isinstance(command, Speed):
            self._speed = command.speed
            self._play(self._playing)
        elif isinstance(command, Step):
            self._play(False)
            self._step()
        else:
            self._make(command)

    def _play(self, playing: bool) -> None:
        self._playing = playing
        self._set_off()
        self._listeners.put(note(self._pace()))

    def _make(self, command: Make) -> None:
        """Replace the world; pages hear first that it is being made, since that may take a while."""
        self._tell(time.perf_counter())
        self._listeners.put(note(self._pace() | {"making": MAKING}))
        try:
            self.world.make(command)
        except WarehouseError:
            self._set_off()
            self._listeners.put(note(self._pace()))
            raise
        self._show()

    def _show(self) -> None:
        """Begin with a world that pages do not know."""
        self._figures, self._lines = LiveFigures(), Lines()
        self._moments: list[Moment] = []  # not sent yet
        self._samples: list[Sample] = []
        for listener in self._listeners.now():
            listener.renew()
        self._set_off()

    def _set_off(self) -> None:
        """Restart the pace."""
        self._since, self._since_steps = time.perf_counter(), self.world.steps
        self._measured, self._measured_steps = self._since, self._since_steps
        self._reached = 0.0

    def _step(self) -> None:
        if self._speed is not None and self.due_in() < -_LATE:
            self._since, self._since_steps = time.perf_counter(), self.world.steps
        moment = self._seen(self.world.step())
        self._moments.append(moment)
        sample = self._figures.add(self.world.seconds, moment)
        if sample is not None:
            self._samples.append(sample)

    def _seen(self, moment: Moment) -> Moment:
        """Return a moment with the numbers of the robots' routes."""
        return moment | {"route": self._lines.numbers(self.world.simulator, 0)}

    def _tell(self, now: float) -> None:
        """Send all pages the new moments, and once a second the pace."""
        self._told_at = now
        if self._moments:
            first, routes = self._first + 1, self._lines.take()
            self._listeners.put(further(self.world, first, self._moments, routes, self._samples))
            self._first += len(self._moments)
            self._moments, self._samples = [], []
        if now - self._measured >= 1.0:
            steps = self.world.steps - self._measured_steps
            self._reached = steps * self.world.step_seconds / (now - self._measured)
            self._measured, self._measured_steps = now, self.world.steps
            self._listeners.put(note(self._pace()))

    def _whole(self) -> bytes:
        """Return the message of the whole world now."""
        moment = self._seen(self.world.moment())
        return whole(self.world, self._first, moment, self._lines.current(), self._figures.samples)

    def _pace(self) -> dict[str, Any]:
        return {"playing": self._playing, "speed": self._speed, "reached": round(self._reached, 3), "making": None}


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
