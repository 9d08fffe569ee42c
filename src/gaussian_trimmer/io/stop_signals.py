"""Ctrl-C, SIGTERM and SIGHUP as an exception, so that what was begun is removed."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

written: list[Path] = []
"""Files and folders that have been written whole since signals are raised, for whoever says that it was stopped."""


class Stopped(KeyboardInterrupt):
    """A signal, whose number is the first argument, has asked the process to stop; a second says what that means.

    After a plain KeyboardInterrupt in `exec`, as in every dataclass, Python ends by SIGINT even if it was caught.
    """


@contextmanager
def stop_signals_raised() -> Iterator[list[int]]:
    """Raise `Stopped` when a signal asks the process to stop; yields the list of the signals that came.

    Whoever finds a signal in the list knows that an error of any type may be the interruption: amid an import it often
    ends in another one. Signals that are ignored, as under `nohup`, or handled by someone else stay so, and outside the
    main thread nothing changes.
    """
    received: list[int] = []
    before = {}
    written.clear()

    def stop(number: int, frame: object) -> None:
        received.append(number)
        raise Stopped(number)

    try:
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            number = getattr(signal, name, None)  # Windows has no SIGHUP
            if number and signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
                with suppress(ValueError):  # in another thread
                    before[number] = signal.signal(number, stop)
        yield received
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
