"""Ctrl-C, SIGTERM and SIGHUP as an exception, so that what was begun is removed."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_written: dict[Path, None] | None = None
"""Files and folders that have been written whole since signals are raised, in order; None while they are not."""


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
    global _written
    received: list[int] = []
    before = {}
    _written = {}

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
        _written = None
        for number, handler in before.items():
            signal.signal(number, handler)


def note_written(path: Path) -> None:
    """Note that a file or folder has been written whole, for whoever says that the command was stopped."""
    if _written is not None:
        _written[path] = None


def written() -> list[Path]:
    """Return what has been written whole since signals are raised."""
    return list(_written or ())
