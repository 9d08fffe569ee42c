"""Runs cases in child processes with limits on memory and time, and keeps count of what becomes of them."""

from __future__ import annotations

import contextlib
import faulthandler
import mmap
import os
import random
import resource
import shutil
import signal
import struct
import tempfile
import time
import traceback
import warnings
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import cv2

from gaussian_trimmer.errors import InputError

from .mutations import mutate
from .samples import Files, Reader, check_message

MEMORY = 2 << 30
"""Address space that a case may take beyond what the process has already."""
SECONDS = 5.0
"""Processor time of a case."""
_PATIENCE = 120.0
"""Seconds on the clock after which a case hangs, however little it computes."""
_CASES_PER_CHILD = 1000
OUTCOMES = ("read", "refused", "traceback", "memory", "slow", "crash")
_NOT_RUN, _READ, _REFUSED, _TRACEBACK, _MEMORY = range(5)


@dataclass
class Tally:
    """What became of the cases of one reader."""

    outcomes: Counter[str] = field(default_factory=Counter)
    defects: list[tuple[int, str, str]] = field(default_factory=list)
    """Number of the case, outcome, and the last lines of what was said."""
    slowest: tuple[int, int] = (0, 0)
    """Milliseconds of processor time of the slowest case, and its number."""


def make_case(reader: Reader, name: str, seed: int, case: int) -> tuple[Files, str]:
    """The files of a case, and the name of the one to read."""
    rng = random.Random(f"{seed}/{name}/{case}")
    files = dict(rng.choice(reader.samples))
    first = next(iter(files))
    others = [data for sample in reader.samples for data in sample.values()]
    target = rng.choice(list(files))
    if case >= len(reader.samples):
        files[target] = mutate(rng, files[target], others)
    else:  # the first cases are the samples as they are
        files = reader.samples[case]
        first = next(iter(files))
    return files, first


def run_cases(reader: Reader, name: str, seed: int, cases: range, keep: Path | None = None) -> Tally:
    """Run cases in as many children as it takes."""
    tally, at = Tally(), cases.start
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)  # before the children are forked, who would wait for threads that they do not have
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            warnings.simplefilter("error", RuntimeWarning)
            while at < cases.stop:
                at = _run_child(reader, name, seed, range(at, min(cases.stop, at + _CASES_PER_CHILD)), tally)
    finally:
        cv2.setNumThreads(threads)
    if keep is not None:
        for case, _, _ in tally.defects:
            folder = keep / f"{name.replace(' ', '-')}-{seed}-{case}"
            folder.mkdir(parents=True, exist_ok=True)
            for file, data in make_case(reader, name, seed, case)[0].items():
                (folder / file).write_bytes(data)
    return tally


def _run_child(reader: Reader, name: str, seed: int, cases: range, tally: Tally) -> int:
    """Run cases until they are done or the child dies; returns the number of the next one."""
    # The number of the case that runs, and of those that ran the outcome and the processor time in milliseconds.
    notes = mmap.mmap(-1, 8 + 3 * len(cases))
    with tempfile.TemporaryFile() as said:
        pid = os.fork()
        if pid == 0:
            _child(reader, name, seed, cases, notes, said.fileno())
        status = _wait(pid, notes)
        said.seek(0)
        messages = dict(_parse(said.read()))
    done = struct.unpack_from("<Q", notes, 0)[0]
    for i, case in enumerate(cases):
        code, milliseconds = struct.unpack_from("<BH", notes, 8 + 3 * i)
        if milliseconds > tally.slowest[0]:
            tally.slowest = milliseconds, case
        if code == _NOT_RUN:
            break
        outcome = OUTCOMES[code - 1]
        tally.outcomes[outcome] += 1
        if code >= _TRACEBACK:
            tally.defects.append((case, outcome, messages.get(case, "")))
    else:
        return cases.stop
    killed = os.WTERMSIG(status) if os.WIFSIGNALED(status) else 0
    outcome = "slow" if killed in (signal.SIGPROF, signal.SIGKILL) else "crash"
    tally.outcomes[outcome] += 1
    tally.defects.append((done, outcome, f"signal {killed}" if killed else f"exit status {status}"))
    return done + 1


def _wait(pid: int, notes: mmap.mmap) -> int:
    """The child's status; a child whose case neither ends nor computes is killed."""
    since, last = time.monotonic(), -1
    while True:
        ended, status = os.waitpid(pid, os.WNOHANG)
        if ended:
            return status
        time.sleep(0.01)
        current = struct.unpack_from("<Q", notes, 0)[0]
        if current != last:
            since, last = time.monotonic(), current
        elif time.monotonic() - since > _PATIENCE:
            os.kill(pid, signal.SIGKILL)
            since = time.monotonic()


def _child(reader: Reader, name: str, seed: int, cases: range, notes: mmap.mmap, said: int) -> None:
    """Run the cases, and never return."""
    folder = Path(tempfile.mkdtemp(prefix="fuzz-", dir="/dev/shm" if os.access("/dev/shm", os.W_OK) else None))
    try:
        faulthandler.disable()
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # of decoders that complain in their own words
        limit = _address_space() + MEMORY
        for i, case in enumerate(cases):
            struct.pack_into("<Q", notes, 0, case)
            try:
                files, first = make_case(reader, name, seed, case)
                for file, data in files.items():
                    (folder / file).write_bytes(data)
            except Exception:
                code, message = _TRACEBACK, _what_was_said()
                begun = time.process_time()
            else:
                begun = time.process_time()
                code, message = _run_case(reader, folder / first, limit)
            if message:
                os.write(said, struct.pack("<QI", case, len(message)) + message)
            milliseconds = round(1000 * (time.process_time() - begun))
            struct.pack_into("<BH", notes, 8 + 3 * i, code, min(milliseconds, 65535))
            for path in folder.iterdir():
                shutil.rmtree(path) if path.is_dir() else path.unlink()
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        os._exit(0)


def _run_case(reader: Reader, path: Path, limit: int) -> tuple[int, bytes]:
    """The outcome's code and, for a defect, what was said."""
    hard = resource.getrlimit(resource.RLIMIT_AS)[1]
    resource.setrlimit(resource.RLIMIT_AS, (limit, hard))
    signal.setitimer(signal.ITIMER_PROF, SECONDS)  # its signal ends the process, whatever that is doing
    try:
        reader.read(path)
        return _READ, b""
    except InputError as error:
        try:
            check_message(error)
        except AssertionError:
            return _TRACEBACK, _what_was_said()
        return _REFUSED, b""
    except MemoryError:
        return _MEMORY, _what_was_said()
    except Exception:
        return _TRACEBACK, _what_was_said()
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        resource.setrlimit(resource.RLIMIT_AS, (hard, hard))


def _what_was_said() -> bytes:
    return traceback.format_exc().encode("utf-8", "backslashreplace")[-3000:]


def _address_space() -> int:
    """Bytes of address space that this process has, where the system says it."""
    with contextlib.suppress(OSError):
        return int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    return 4 << 30


def _parse(data: bytes) -> list[tuple[int, str]]:
    """The messages that a child left, with the numbers of their cases."""
    found, at = [], 0
    while at + 12 <= len(data):
        case, size = struct.unpack_from("<QI", data, at)
        found.append((case, data[at + 12 : at + 12 + size].decode("utf-8", "replace")))
        at += 12 + size
    return found
