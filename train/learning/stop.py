"""A clean stop of a training on Ctrl-C or a termination."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def stop_signal() -> Iterator[threading.Event]:
    """Yield an event that Ctrl-C or SIGTERM sets, so that the running update ends; a second signal exits at once.

    At the end the signal is raised again with its usual effect.
    """
    stop = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield stop
        return

    asked: list[signal.Signals] = []

    def ask(number: int, frame: object) -> None:
        if asked:
            os._exit(130)
        asked.append(signal.Signals(number))
        stop.set()

    before = {number: signal.signal(number, ask) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if asked:
        signal.raise_signal(asked[0])
        raise KeyboardInterrupt  # where the signal is ignored, as it is in the background of a shell
