"""A short run of `fuzz` over every reader, and what its harness makes of readers that misbehave."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

if not sys.platform.startswith("linux"):
    pytest.skip("limits on memory and time are those of Linux", allow_module_level=True)

from fuzz import harness
from fuzz.samples import Reader, readers

from gaussian_trimmer.errors import InputError

CASES = 160
READERS = readers()


def test_cut_outs_in_a_process_of_their_own():
    """Their rows are found by compiled code, whose threads a forked child of the tests would not have."""
    command = [sys.executable, "-m", "tests.fuzz", "--cases", str(CASES), "--seed", "0", "--reader", "subset"]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    root = Path(__file__).parents[1]
    done = subprocess.run(command, cwd=root, env=environment, capture_output=True, text=True, check=False, timeout=600)
    assert done.returncode == 0 and "0 defects" in done.stdout, done.stdout + done.stderr


@pytest.mark.parametrize("name", [name for name in READERS if name != "subset"])
def test_readers_succeed_or_refuse(name):
    tally = harness.run_cases(READERS[name], name, 0, range(CASES))
    assert tally.defects == [], "\n".join(f"case {case}: {outcome}\n{said}" for case, outcome, said in tally.defects)
    assert sum(tally.outcomes.values()) == CASES
    assert tally.outcomes["read"] >= len(READERS[name].samples)  # the samples themselves come first
    assert tally.outcomes["refused"] > CASES // 4


def misbehave(path: Path) -> None:
    """A reader that does what the file says."""
    match path.read_bytes():
        case b"read":
            return
        case b"refuse":
            raise InputError("The file says no, and that is a sentence.")
        case b"escape":
            error = InputError("The file says something else.")
            error.args = ("\x1b[2J to the terminal",)
            raise error
        case b"raise":
            raise KeyError("no sentence")
        case b"eat":
            bytearray(3 << 30)
        case b"loop":
            while True:
                pass
        case b"hang":
            time.sleep(1000)
        case b"crash":
            os.kill(os.getpid(), signal.SIGSEGV)
        case b"leave":
            os._exit(3)


def test_the_harness_sees_what_readers_do(monkeypatch, tmp_path):
    monkeypatch.setattr(harness, "SECONDS", 0.3)
    monkeypatch.setattr(harness, "_PATIENCE", 1.0)
    monkeypatch.setattr(harness, "_CASES_PER_CHILD", 4)
    told = ["read", "crash", "refuse", "escape", "raise", "eat", "loop", "read", "hang", "leave", "refuse"]
    reader = Reader([{"a": word.encode()} for word in told], misbehave)
    tally = harness.run_cases(reader, "misbehave", 0, range(len(told)), keep=tmp_path)
    expected = {1: "crash", 3: "traceback", 4: "traceback", 5: "memory", 6: "slow", 8: "slow", 9: "crash"}
    assert {case: outcome for case, outcome, _ in tally.defects} == expected
    assert tally.outcomes == {"read": 2, "refused": 2, "traceback": 2, "memory": 1, "slow": 2, "crash": 2}
    assert "KeyError: 'no sentence'" in next(said for case, _, said in tally.defects if case == 4)
    assert (tmp_path / "misbehave-0-6" / "a").read_bytes() == b"loop"


def test_a_case_is_settled_by_its_numbers():
    cases = [harness.make_case(READERS["ply"], "ply", 3, case) for case in range(20, 60)]
    assert cases == [harness.make_case(READERS["ply"], "ply", 3, case) for case in range(20, 60)]
    assert len({data for files, _ in cases for data in files.values()}) > 30
