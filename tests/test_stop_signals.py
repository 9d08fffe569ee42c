"""Ctrl-C, SIGTERM and SIGHUP end a run with the code that shells expect, and without a word."""

import gc
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from scenes import front_camera, random_scene

from gaussian_trimmer.io import stop_signals
from gaussian_trimmer.io.stop_signals import STOP_SIGNALS, Stopped, stop_signals_delayed, stop_signals_raised
from gaussian_trimmer.rendering import get_renderer

pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGUSR1"), reason="needs signals")


@pytest.fixture
def user_signal(monkeypatch):
    """A signal that takes the part of Ctrl-C, and does nothing when it comes too late for its test."""
    before = signal.signal(signal.SIGUSR1, lambda number, frame: None)
    monkeypatch.setattr(stop_signals, "STOP_SIGNALS", (signal.SIGUSR1,))
    yield signal.SIGUSR1
    signal.signal(signal.SIGUSR1, before)


def wait():
    for _ in range(2000):
        time.sleep(0.005)
    pytest.fail("the signal was lost")


def test_signal_is_raised_and_listed(user_signal):
    with stop_signals_raised() as received:
        with pytest.raises(Stopped):
            signal.raise_signal(user_signal)
        assert received == [user_signal]
    signal.raise_signal(user_signal)
    assert received == [user_signal]


def test_signal_in_a_destructor_is_raised_after_it(user_signal, capsys):
    class Dying:
        def __del__(self):
            signal.raise_signal(user_signal)

    with stop_signals_raised(), pytest.raises(Stopped):
        Dying()
        gc.collect()
        wait()
    assert capsys.readouterr().err == ""


def test_signal_in_what_compiled_code_calls_is_raised_after_it(user_signal):
    finished = []

    def _numba_unpickle():
        signal.raise_signal(user_signal)
        finished.append("called")

    def kernel():
        _numba_unpickle()
        finished.append("caller")

    with stop_signals_raised(), pytest.raises(Stopped):
        kernel()
    assert finished == ["called"]


def test_signal_amid_kernels_is_nothing_but_stopped(user_signal):
    """Numba's wrappers call Python while they hand over results, and an exception there may crash the process."""
    scene, camera, renderer = random_scene(0), front_camera(), get_renderer("numba")
    renderer.render(scene, camera, weights=True)
    for i in range(20):
        timer = threading.Timer(0.005 + 0.003 * i, os.kill, (os.getpid(), user_signal))
        with stop_signals_raised(), pytest.raises(Stopped):
            timer.start()
            for _ in range(10_000):
                renderer.render(scene, camera, weights=True)
        timer.join()


def test_delayed_signal_comes_at_the_end(user_signal):
    done = []
    with stop_signals_raised(), pytest.raises(Stopped):
        with stop_signals_delayed():
            signal.raise_signal(user_signal)
            done.append(1)
        done.append(2)
    assert done == [1]


def test_ignored_signals_stay_ignored_and_other_threads_are_left_alone():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with stop_signals_raised() as received, stop_signals_delayed():
            signal.raise_signal(signal.SIGHUP)
        assert received == []
        assert signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)

    def work():
        with stop_signals_raised(), stop_signals_delayed():
            handlers.append(signal.getsignal(signal.SIGINT))

    handlers = [signal.getsignal(signal.SIGINT)]
    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert handlers[0] == handlers[1]


ENVIRONMENT = {**os.environ, "PYTHONPATH": str(Path(stop_signals.__file__).parents[1])}
MAIN = """
import os, signal, sys
from gaussian_trimmer import cli
number = int(sys.argv[1])
{setup}
if command:
    cli._dispatch = command
sys.exit(cli.main(["demo", "--output", sys.argv[2]]))
"""
WAYS = {
    "in plain code": "def command(_): signal.raise_signal(number)",
    "in exec, which makes Python forget the exit code": (
        "def command(_): exec('signal.raise_signal(number)', globals())"
    ),
    "as another error": """
class Name:
    def __set_name__(self, owner, name): signal.raise_signal(number)
def command(_):
    class Field: name = Name()""",
    "as an error of the user": """
from gaussian_trimmer.errors import InputError
def command(_):
    try: signal.raise_signal(number)
    except BaseException: raise InputError('PyTorch is missing.')""",
    "swallowed": """
def command(_):
    try: signal.raise_signal(number)
    except BaseException: return 0""",
    **{
        f"as {module} is imported": f"""
command = None
class Finder:
    def find_spec(name, *_):
        if name == {module!r}: os.kill(os.getpid(), number)
sys.meta_path.insert(0, Finder)"""
        for module in (
            "gaussian_trimmer.io.stop_signals",
            "tyro",
            "numpy.linalg",
            "cv2",
            "numba",
            "gaussian_trimmer.config",
        )
    },
}


@pytest.mark.parametrize("way", WAYS)
def test_stopped_command_is_silent_and_has_the_code_of_the_signal(tmp_path, way):
    script = MAIN.format(setup=WAYS[way])
    for number in STOP_SIGNALS if way.startswith(("in", "swallowed")) else STOP_SIGNALS[:1]:
        command = [sys.executable, "-c", script, str(int(number)), str(tmp_path / "out")]
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=ENVIRONMENT)
        assert (done.returncode, done.stderr) == (128 + number, "")
        assert list(tmp_path.iterdir()) == []
