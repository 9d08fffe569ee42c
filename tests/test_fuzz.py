"""Every reader against files that are damaged at random, with limits on memory and time.

Readers may succeed or raise InputError with a sentence fit for a terminal; whatever else happens is a defect. The
environment variables CASES and SEED say how often and how each is tried; a defect tells what repeats it, and if the
process dies, the end of standard error does.
"""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import tempfile
import traceback
import warnings
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest

if not sys.platform.startswith("linux"):
    pytest.skip("limits on memory and time are those of Linux", allow_module_level=True)

import resource

from fuzz.mutations import mutate
from fuzz.planted import try_folder
from fuzz.samples import Files, Reader, check_message, readers

from gaussian_trimmer.errors import InputError

CASES, SEED = int(os.environ.get("CASES", "300")), os.environ.get("SEED", "0")
MEMORY = 2 << 30
"""Address space beyond what the process has when it begins."""
SECONDS = 5.0
"""Processor time of a case."""


def make_case(reader: Reader, name: str, case: int) -> Files:
    """The files of a case, of which the first is to be read; the first cases are the samples as they are."""
    if case < len(reader.samples):
        return reader.samples[case]
    rng = random.Random(f"{SEED}/{name}/{case}")
    files = dict(rng.choice(reader.samples))
    target = rng.choice(list(files))
    files[target] = mutate(rng, files[target])
    return files


def defects(reader: Reader, name: str, cases: Iterable[int]) -> Iterator[str]:
    """Cases that neither succeed nor are refused with a sentence; the samples themselves must be read."""
    for case in cases:
        print(f"\r{name} {case}", end="", file=sys.stderr, flush=True)
        try:
            with tempfile.TemporaryDirectory() as folder:
                signal.setitimer(signal.ITIMER_PROF, SECONDS)
                files = make_case(reader, name, case)
                for file, data in files.items():
                    (Path(folder) / file).parent.mkdir(parents=True, exist_ok=True)
                    (Path(folder) / file).write_bytes(data)
                try:
                    reader.read(Path(folder) / next(iter(files)))
                except InputError as error:
                    check_message(error)
                    assert case >= len(reader.samples), error
        except Exception:
            yield f"SEED={SEED} {name} case {case}\n{traceback.format_exc()[-1500:]}"
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)


def stop(*_: object) -> None:
    raise TimeoutError(f"more than {SECONDS} s")


def try_reader(name: str, *cases: int) -> None:
    """Try some cases, or as many as CASES says, in this process, and print the defects."""
    in_use = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (in_use + MEMORY, resource.getrlimit(resource.RLIMIT_AS)[1]))
    signal.signal(signal.SIGPROF, stop)
    warnings.simplefilter("ignore")
    warnings.simplefilter("error", RuntimeWarning)
    print(*defects(readers()[name], name, cases or range(CASES)), "end", sep="\n")


@pytest.mark.slow
@pytest.mark.parametrize("name", readers())
def test_readers_succeed_or_refuse(name: str) -> None:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    command = [sys.executable, "-c", f"from test_fuzz import try_reader; try_reader({name!r})"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False, timeout=600)
    assert (done.returncode, done.stdout.strip()) == (0, "end"), done.stdout + done.stderr


def test_planted_folders_change_nothing_elsewhere(tmp_path: Path) -> None:
    for case in range(CASES // 2):
        try:
            try_folder(random.Random(f"{SEED}/planted/{case}"), tmp_path / str(case))
        except Exception as error:
            raise AssertionError(f"SEED={SEED} planted case {case}") from error


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
    found = list(defects(Reader([{"a": word.encode()} for word in words], misbehave), "misbehave", range(5)))
    # A sample must be read, so that refusing the first ones is a defect too.
    assert [text.split("\n")[0].split()[-1] for text in found] == ["1", "2", "3"]
    assert "KeyError: 'no sentence'" in found[2]
    refusing = Reader([{"a": b"read"}], lambda path: misbehave(path.write_bytes(b"refuse") and path))
    assert not list(defects(refusing, "refuse", range(1, 9)))
