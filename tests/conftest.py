"""How the tests share a machine: kernels are compiled once, before the workers start, and each worker has its cores."""

import os
import shutil
import signal
import subprocess
import sys
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from browser import installed

TESTS = Path(__file__).parent
FILLS = ("drawing", "searching and fitting")
"""Parts of `fill_kernels.py`, which are compiled side by side."""


def pytest_configure(config):
    """Fill the cache of kernels with two processes at a time, in the process that starts the workers."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        # A shell starts programs in the background so; tests send this signal to programs that inherit it.
        signal.signal(signal.SIGINT, signal.default_int_handler)
    # Programs that tests start import the sources that are tested, and find their compiled kernels.
    os.environ["PYTHONPATH"] = os.pathsep.join([str(TESTS.parent / "src"), os.environ.get("PYTHONPATH", "")])
    if not is_worker(config):
        state = TemporaryDirectory(prefix="gaussian-trimmer-state-")
        config.add_cleanup(state.cleanup)
        os.environ["XDG_STATE_HOME"] = state.name
    if is_worker(config) or not getattr(config.option, "numprocesses", None) or config.option.collectonly:
        return
    filling = [subprocess.Popen([sys.executable, TESTS / "fill_kernels.py", part]) for part in FILLS]
    codes = [process.wait() for process in filling]
    if any(codes):
        raise pytest.UsageError("The kernels could not be compiled; what went wrong stands above.")


def pytest_sessionstart(session):
    """Give a worker its share of the cores: threads of two workers on one core wait for each other."""
    if is_worker(session.config):
        import numba

        workers = session.config.workerinput["workercount"]
        numba.set_num_threads(max(1, numba.config.NUMBA_NUM_THREADS // workers))


def pytest_collection_modifyitems(config, items):
    """Leave out tests marked `needs("torch")` and the like where that is not installed."""

    def can_run(item):
        return all(is_installed(name) for mark in item.iter_markers("needs") for name in mark.args)

    missing = [item for item in items if not can_run(item)]
    if missing:
        config.hook.pytest_deselected(items=missing)
        items[:] = filter(can_run, items)


@cache
def is_installed(name):
    if name == "browser":
        return bool(find_spec("playwright") and installed())
    if name == "splat-transform":
        return bool(os.environ.get("SPLAT_TRANSFORM") or shutil.which(name))
    return find_spec(name) is not None


def is_worker(config):
    return hasattr(config, "workerinput")


@pytest.fixture(scope="module")
def one_thread():
    """So few pixels as a toy scene's views lose more to the threads than they gain."""
    from toy import one_thread

    with one_thread():
        yield


@pytest.fixture(scope="module")
def ball(tmp_path_factory):
    """The ball of `toy`, as files in a folder: the folder, the scene and which Gaussians are the ball."""
    from command_line import save_ball

    folder = tmp_path_factory.mktemp("ball")
    return folder, *save_ball(folder)


@pytest.fixture
def session(ball):
    """A session of the app in which the ball's scene is open."""
    from gaussian_trimmer.app.session import Session

    opened = Session()
    opened.open(ball[0] / "scene.ply", ball[0] / "cameras.json")
    return opened
