"""Ctrl-C, SIGTERM and SIGHUP end a command with a sentence and the code that shells expect, and no trace on disk."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from gaussian_trimmer import cli
from gaussian_trimmer.commands.pools import _cluster
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.io.folders import atomic_folder
from gaussian_trimmer.io.writing import Stopped, stop_signals_raised, write_whole

pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="needs signals")

SCRIPT = """
import signal, sys
from pathlib import Path
from gaussian_trimmer import cli
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.io.folders import atomic_folder
from gaussian_trimmer.io.writing import atomic_file
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # where the tests run under nohup, it is ignored
def command(_):
    with atomic_folder(Path(sys.argv[2]), "test") as folder, atomic_file(folder / "file"):
        {body}
cli._dispatch = command
sys.exit(cli.main([]))
"""
BODIES = {
    "in plain code": "signal.raise_signal(int(sys.argv[1]))",
    "in exec, after which Python forgets exit codes": "exec('signal.raise_signal(int(sys.argv[1]))', globals())",
    "as another error": """
        try: signal.raise_signal(int(sys.argv[1]))
        except BaseException: raise InputError('PyTorch is missing.')""",
    "in a finalizer, which swallows it": """
        class Finalized:
            def __del__(self): signal.raise_signal(int(sys.argv[1]))
        Finalized()
        import time
        time.sleep(60)""",
}


@pytest.mark.parametrize("body", BODIES.values(), ids=BODIES)
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_stopped_command_says_so_cleans_up_and_has_the_code_of_the_signal(tmp_path, name, body):
    number = getattr(signal, name)
    command = [sys.executable, "-c", SCRIPT.format(body=body), str(int(number)), str(tmp_path / "a" / "out")]
    environment = {**os.environ, "PYTHONPATH": str(Path(cli.__file__).parents[1])}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert (done.returncode, done.stderr) == (128 + number, "gaussian-trimmer: Stopped; nothing was written.\n")
    assert list(tmp_path.iterdir()) == []


def test_what_a_stopped_command_has_written_is_said(tmp_path, monkeypatch, capsys):
    def command(_):
        write_whole(tmp_path / "a.npy", "a")
        with atomic_folder(tmp_path / "out", "test") as folder:
            write_whole(folder / "b", "b")
            signal.raise_signal(signal.SIGTERM)

    monkeypatch.setattr(cli, "_dispatch", command)
    assert cli.main([]) == 128 + signal.SIGTERM
    assert capsys.readouterr().err == f"gaussian-trimmer: Stopped; {tmp_path / 'a.npy'} had been written.\n"


def test_ignored_signals_stay_ignored_and_handlers_come_back(monkeypatch):
    seen = []
    monkeypatch.setattr(cli, "_dispatch", lambda _: seen.append([signal.getsignal(n) for n in numbers]) or 0)
    numbers = (signal.SIGHUP, signal.SIGTERM)
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        assert cli.main([]) == 0
    finally:
        signal.signal(signal.SIGHUP, before)
    ((hangup, terminate),) = seen
    assert hangup == signal.SIG_IGN
    assert terminate != signal.SIG_DFL == signal.getsignal(signal.SIGTERM)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_while_ray_starts_waits_until_it_has_started_and_shuts_it_down(monkeypatch, number):
    happened, before = [], signal.getsignal(signal.SIGTERM)

    def init(**options):
        if threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(number))  # as Ray does
        time.sleep(0.1)  # until the main thread waits
        os.kill(os.getpid(), number)
        time.sleep(0.1)
        happened.append("started")

    stand_in = SimpleNamespace(init=init, shutdown=lambda: happened.append("shut down"))
    monkeypatch.setitem(sys.modules, "ray", stand_in)
    with stop_signals_raised() as received, pytest.raises(Stopped), _cluster(None, None):
        pass
    assert received == [number]
    assert happened == ["started", "shut down"]
    assert signal.getsignal(signal.SIGTERM) == before


@pytest.mark.parametrize(("address", "cure"), [(None, "start the batch again."), ("auto", "RAY_AUTH_MODE=token.")])
def test_a_ray_that_does_not_start_is_a_sentence_with_its_cure(monkeypatch, address, cure):
    def init(**options):
        raise ConnectionError("timed out")

    monkeypatch.setitem(sys.modules, "ray", SimpleNamespace(init=init, shutdown=lambda: None))
    with pytest.raises(InputError, match=rf"No Ray cluster .* \(timed out\)\. .*{cure}$"), _cluster(address, None):
        pass


def test_a_signal_while_ray_ends_does_not_interrupt_that(monkeypatch):
    happened = []

    def shutdown():
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(0.2)
        happened.append("shut down")

    monkeypatch.setitem(sys.modules, "ray", SimpleNamespace(init=lambda **options: None, shutdown=shutdown))
    with stop_signals_raised(), pytest.raises(Stopped), _cluster(None, None):
        pass
    assert happened == ["shut down"]
