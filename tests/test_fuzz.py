"""Runs of `fuzz` over every reader, each in a process of its own, and what it makes of readers that misbehave."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

if not sys.platform.startswith("linux"):
    pytest.skip("limits on memory and time are those of Linux", allow_module_level=True)

from fuzz.__main__ import defects
from fuzz.samples import Reader, readers

from gaussian_trimmer.errors import InputError

CASES = 300
READERS = readers()


@pytest.mark.slow
@pytest.mark.parametrize("name", READERS)
def test_readers_succeed_or_refuse(name: str) -> None:
    command = [sys.executable, "-m", "tests.fuzz", "--cases", str(CASES), "--seed", "0", "--reader", name]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    root = Path(__file__).parents[1]
    done = subprocess.run(command, cwd=root, env=environment, capture_output=True, text=True, check=False, timeout=600)
    assert (done.returncode, done.stdout.split("\n")[-2]) == (0, f"{CASES} cases, 0 defects"), done.stdout + done.stderr


def test_misbehaviour_is_seen() -> None:
    def misbehave(path: Path) -> None:
        match path.read_bytes():
            case b"refuse":
                raise InputError("The file says no, and that is a sentence.")
            case b"escape":
                error = InputError("The file says something else.")
                error.args = ("\x1b[2J to the terminal",)
                raise error
            case b"raise":
                raise KeyError("no sentence")

    words = ["read", "refuse", "escape", "raise", "read"]
    found = dict(defects(Reader([{"a": word.encode()} for word in words], misbehave), "misbehave", 0, range(5)))
    assert sorted(found) == [1, 2, 3]  # a sample must be read, so that refusing the first ones is a defect too
    assert "KeyError: 'no sentence'" in found[3]
    refusing = Reader([{"a": b"read"}], lambda path: misbehave(path.write_bytes(b"refuse") and path))
    assert [case for case, _ in defects(refusing, "refuse", 0, range(1, 9))] == []
