"""Ctrl-C, SIGTERM and SIGHUP: an exception that cleans up, or a delay where a step must not be cut in two."""

from __future__ import annotations

import _thread
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

STOP_SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
_SECONDS_UNTIL_AGAIN = 0.005
_CALLED_BY_KERNELS = ("_numba_unpickle",)
"""Functions that Numba's compiled code calls while it hands its results to Python, without a look at their errors."""


class Stopped(KeyboardInterrupt):
    """A signal, whose number is the argument, has asked the process to stop.

    Where KeyboardInterrupt itself has passed through `exec`, as in every dataclass, Python forgets the exit code and
    ends by SIGINT, even if it was caught afterwards.
    """


@contextmanager
def stop_signals_raised() -> Iterator[list[int]]:
    """Raise `Stopped` when a signal asks the process to stop; gives the list of the signals that came.

    Whoever reads the list knows that an error of any type may be the interruption: what is interrupted amid an import
    often ends in an ImportError or a RuntimeError. Where the interpreter can only ignore the exception, as in a
    destructor, or where compiled code would take no notice of it, it is raised a moment later. Signals that are
    ignored, as under `nohup`, stay ignored; outside the main thread nothing is changed.
    """
    received: list[int] = []

    def stop(number: int, frame: FrameType | None) -> None:
        received.append(number)
        caller = _caller_of_compiled_code(frame)
        if caller is None:
            raise Stopped(number)
        _raise_when_back_in(caller, number)

    def again(number: int) -> None:
        time.sleep(_SECONDS_UNTIL_AGAIN)
        if sys.unraisablehook is ignored:
            signal.raise_signal(number)

    def ignored(unraisable: Any) -> None:
        if not received:
            before(unraisable)
        elif issubclass(unraisable.exc_type, Stopped):
            _thread.start_new_thread(again, (received[-1],))

    before, sys.unraisablehook = sys.unraisablehook, ignored
    try:
        with _handler(stop):
            yield received
    finally:
        sys.unraisablehook = before


@contextmanager
def stop_signals_delayed() -> Iterator[None]:
    """Let signals that ask the process to stop wait; at the end they do what they would have done."""
    waiting: list[int] = []
    try:
        with _handler(lambda number, frame: waiting.append(number)):
            yield
    finally:
        for number in dict.fromkeys(waiting):
            signal.raise_signal(number)


def _caller_of_compiled_code(frame: FrameType | None) -> FrameType | None:
    """The frame that called compiled code in which an exception might crash the process; None where there is none."""
    caller = None
    while frame is not None:
        if frame.f_code.co_name in _CALLED_BY_KERNELS:
            caller = frame.f_back
        frame = frame.f_back
    return caller


def _raise_when_back_in(frame: FrameType, number: int) -> None:
    def trace(*_: object) -> None:
        sys.settrace(before)
        raise Stopped(number)

    before = sys.gettrace()
    frame.f_trace = trace
    sys.settrace(lambda *_: None)


@contextmanager
def _handler(handle: Callable[[int, FrameType | None], None]) -> Iterator[None]:
    """Have the signals handled by a function, those apart that are ignored or handled outside Python."""
    replaced: dict[int, Any] = {}
    try:
        if threading.current_thread() is threading.main_thread():
            for number in STOP_SIGNALS:
                before = signal.getsignal(number)
                if before not in (None, signal.SIG_IGN):
                    replaced[number] = before
                    signal.signal(number, handle)
        yield
    finally:
        for number, before in replaced.items():
            signal.signal(number, before)
