"""Ctrl-C, SIGTERM and SIGHUP as an exception, so that what was begun is removed."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress


class Stopped(KeyboardInterrupt):
    """A signal, whose number is the argument, has asked the process to stop.

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
