"""Children of the test process, and what becomes of them."""

import os
import signal
import sys
import traceback

import pytest

needs_fork = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs processes that fork")
CHANGES = ("rename", "replace", "mkdir", "rmdir", "unlink", "fsync")
"""Functions of `os` that everything written goes through."""


def start(work):
    """Fork a child that runs a function; returns its process number. Its exit code is what the function returns."""
    sys.stdout.flush()
    child = os.fork()
    if child == 0:
        code = 70
        try:
            code = work() or 0
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(code)
    return child


def end(child):
    """Exit code of a child, minus the signal's number if that killed it."""
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def holding(context):
    """Start a child that enters a context and stays in it; returns its process number when it is inside."""
    inside, told = os.pipe()

    def work():
        with context:
            os.write(told, b"x")
            signal.pause()

    child = start(work)
    os.close(told)
    assert os.read(inside, 1) == b"x"
    os.close(inside)
    return child


def counted(act, functions=CHANGES):
    """Replace functions of `os` by ones that first call `act(k)` at the k-th call of any of them, from 1.

    Returns the list of calls, which is filled as they come, and a function that takes all back.
    """
    calls, originals = [], {name: getattr(os, name) for name in functions}

    def replacement(name):
        def call(*arguments, **options):
            calls.append(name)
            act(len(calls))
            return originals[name](*arguments, **options)

        return call

    for name in functions:
        setattr(os, name, replacement(name))
    return calls, lambda: [setattr(os, name, original) for name, original in originals.items()]


def signal_at(k, number):
    """What `counted` calls to send this process a signal at the k-th call."""

    def act(call):
        if call == k:
            os.kill(os.getpid(), number)

    return act
