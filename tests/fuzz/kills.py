"""Commands that are killed at any moment, and what they leave.

    python -m tests.fuzz.kills --rounds 300 --seed 1

A round starts a command in a new folder or over earlier results, with a file of the user beside them, and sends it a
signal: at any time of its run, or as soon as it writes. Each result must then be the earlier one or the new one, whole;
SIGINT, SIGTERM and SIGHUP end silently, with the code that shells expect and no trace, and after SIGKILL the same
command makes what it makes undisturbed. `--seed`, `--what` and `--round` repeat a round as far as the machine does.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
import batch_runs
import numpy as np
import toy

import gaussian_trimmer
from gaussian_trimmer import formats

READY = "ready"
COMMAND = f"import sys; from gaussian_trimmer.cli import main; print({READY!r}, flush=True); sys.exit(main())"
SAVE = f"""
import sys
from pathlib import Path
from gaussian_trimmer.app import edits
from gaussian_trimmer.app.files import save
from gaussian_trimmer.app.project import project_as_json, write_private
from gaussian_trimmer.app.session import Session
from gaussian_trimmer.app.snapshots import TrimChoices
from gaussian_trimmer.selecting.marks import Sphere
session, output = Session(), Path(sys.argv[2])
session.open(Path(sys.argv[1]))
session.do(edits.mark, Sphere((0.0, 0.0, 1.0), 1.2 if sys.argv[3] == "new" else 1.1))
session.do(edits.trim_object, TrimChoices())
print({READY!r}, flush=True)
write_private(output / "kept" / "project.json", project_as_json(session.now, output))
save(session.now, output / "results", overwrite=True)
"""
QUICK = ["--set", "plan.size=96", "--views", "2", "--refine", "off", "--up", "z", "--quiet", "--overwrite"]
TIMES = ("report.json", "manifest.json", "summary.csv")
"""What holds times, or sizes of files with times."""
MINE = "mine.txt"
SECONDS = 600.0
NO_CLUSTER = "No Ray cluster could be started here"
"""Ray gives its processes half a minute, which is too little beside other work."""
Files = dict[str, bytes]


@dataclass
class Work:
    """A command that writes results."""

    start: Callable[[Path, str], list[str]]
    """Arguments of Python, for a folder and "old" or "new"."""
    signals: tuple[signal.Signals, ...] = (signal.SIGKILL,) * 3 + (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    unit: Callable[[str], str] = lambda name: ""
    """Which result a file belongs to, each of which is whole by itself."""
    seconds: float = 0.0
    """How long it runs undisturbed."""
    results: dict[str, Path] = field(default_factory=dict)
    """Folders that it has written undisturbed."""


def works(folder: Path) -> dict[str, Work]:
    """Return all commands, on a scene that is written into a folder."""
    scene, truth = toy.ball_on_floor(n_ball=300, floor_side=16)
    formats.write(scene, folder / "scene.ply")
    for age, margin in (("old", 0.3), ("new", 0.4)):
        np.save(folder / f"{age}.npy", toy.dilated(scene, truth, margin))
        batch_runs.write_manifest(folder, [f"scene-{k}" for k in range(4)], file=f"{age}.csv")
        rows = (folder / f"{age}.csv").read_text()
        for k in range(4):
            rows = rows.replace(f"scene-{k}.npy", f"{age}.npy")
        (folder / f"{age}.csv").write_text(rows)
    file = str(folder / "scene.ply")

    def trim(output: Path, age: str) -> list[str]:
        return ["-c", COMMAND, "trim", file, str(folder / f"{age}.npy"), "--output", str(output / "results"), *QUICK]

    def select(output: Path, age: str) -> list[str]:
        marks = ["--add", str(folder / f"{age}.npy"), "--up", "z", "--quiet", "--overwrite"]
        return ["-c", COMMAND, "select", file, *marks, "--output", str(output / "rows.npy")]

    def batch(output: Path, age: str, *engine: str) -> list[str]:
        arguments = ["--output", str(output / "batch"), "--quiet", "--workers", "1", *engine]
        return ["-c", COMMAND, "batch", str(folder / f"{age}.csv"), *arguments]

    def item(name: str) -> str:
        return "/".join(name.split("/")[:3])

    found = {
        "trim": Work(trim),
        "select": Work(select),
        "batch": Work(batch, unit=item),
        "save": Work(lambda output, age: ["-c", SAVE, file, str(output), age], (signal.SIGKILL,), item),
    }
    if find_spec("ray"):
        found["ray"] = Work(lambda output, age: batch(output, age, "--engine", "ray"), unit=item)
    return found


def contents(folder: Path) -> Files:
    """Return all files of a folder but those with times."""
    files = {path.relative_to(folder).as_posix(): path for path in folder.rglob("*") if path.is_file()}
    return {name: path.read_bytes() for name, path in files.items() if not set(TIMES).intersection(name.split("/"))}


def started(work: Work, output: Path, age: str) -> subprocess.Popen[str]:
    """Start a command, and return it when its own code begins."""
    sources = str(Path(gaussian_trimmer.__file__).parents[1])
    environment = {**os.environ, "PYTHONPATH": sources, "PYTHONFAULTHANDLER": "1"}  # a crash says where
    command = [sys.executable, *work.start(output, age)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    process = subprocess.Popen(command, text=True, env=environment, **pipes)
    assert process.stdout is not None
    assert process.stdout.readline() == f"{READY}\n", process.communicate()[1]
    return process


def finish(work: Work, output: Path, age: str) -> None:
    """Run a command undisturbed."""
    for _ in range(5):
        process, begun = started(work, output, age), time.monotonic()
        code, _, err = batch_runs.end(process, SECONDS)
        if NO_CLUSTER not in err:
            break
    assert (code, err) == (0, ""), f"undisturbed: code {code}, {err[-1000:]}"
    work.seconds = time.monotonic() - begun


def play(work: Work, output: Path, rng: random.Random) -> str:
    """Play a round in a folder, and return what was done; AssertionError tells a defect."""
    if earlier := rng.random() < 0.5:
        shutil.copytree(work.results["old"], output, dirs_exist_ok=True)
    (output / MINE).write_text("mine")
    before, new = contents(output), {MINE: b"mine", **contents(work.results["new"])}
    number, moment, aimed = rng.choice(work.signals), rng.random(), rng.random() < 0.5
    process = started(work, output, "new")
    if aimed:
        while process.poll() is None and not any(output.rglob(".gaussian-trimmer*")):
            time.sleep(0.001)
    time.sleep(moment * (0.3 if aimed else work.seconds))
    process.send_signal(number)
    code, _, err = batch_runs.end(process, SECONDS)
    is_late = code == 0 or NO_CLUSTER in err
    told = f"{number.name} {'while it wrote' if aimed else f'at {moment:.2f}'}{' over results' * earlier}, code {code}"
    if number == signal.SIGKILL or is_late:
        finish(work, output, "new")
        _check(contents(output) == new, f"{told}: the next run made something else", contents(output), new)
    else:
        # Before a command takes the signals it has begun nothing.
        said = re.fullmatch(r"(gaussian-trimmer: Stopped[^\n]*\n)?", err)
        _check(code in (128 + number, -number) and bool(said), f"{told}: {err[-1000:]}")
        for unit in {work.unit(name) for name in (*before, *new)}:
            is_mine, now = (lambda name, unit=unit: work.unit(name) == unit), contents(output)
            state, old, made = ({n: d for n, d in files.items() if is_mine(n)} for files in (now, before, new))
            _check(state in (old, made), f"{told}: '{unit}' is neither the earlier nor the new result", state, made)
    return told + " (too late)" * is_late


def _check(is_right: bool, said: str, found: Files | None = None, wanted: Files | None = None) -> None:
    names = found is not None and wanted is not None and sorted(set(found.items()) ^ set(wanted.items()))
    assert is_right, f"{said} {json.dumps([name for name, _ in names][:20]) if names else ''}"


def rounds(chosen: dict[str, Work], folder: Path, numbers: range, seed: int) -> Iterator[str]:
    """Play rounds, and give the defects."""
    done = Counter[str]()
    for number in numbers:
        name, rng = list(chosen)[number % len(chosen)], random.Random(f"{seed}/{number}")
        output = folder / f"round-{number}"
        output.mkdir()
        try:
            told = play(chosen[name], output, rng)
            done[f"{name} {told.split()[0]}{' too late' * told.endswith(')')}"] += 1
            shutil.rmtree(output, ignore_errors=True)
        except AssertionError as error:
            if NO_CLUSTER in str(error):
                done[f"{name} not played: no cluster"] += 1
                continue
            yield f"--seed {seed} --round {number}, {name}: {error}"
        if (number + 1) % 25 == 0:
            print(f"{number + 1} rounds", flush=True)
    print("\n".join(f"{count:5} {name}" for name, count in sorted(done.items())))


def main() -> int:
    """Play the rounds and list the defects."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz.kills", description="Commands that are killed.")
    parser.add_argument("--rounds", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--what", action="append", choices=["trim", "select", "batch", "save", "ray"])
    parser.add_argument("--round", type=int, help="play this round alone")
    options = parser.parse_args()
    signal.signal(signal.SIGINT, signal.default_int_handler)  # else it may be ignored, here and in what is started
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    defects = 0
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
        folder = Path(name)
        os.environ["RAY_TMPDIR"] = name
        found = works(folder)
        chosen = {kind: work for kind, work in found.items() if kind in (options.what or found)}
        for kind, work in chosen.items():
            for age in ("old", "new"):
                work.results[age] = folder / kind / age
                work.results[age].mkdir(parents=True)
                finish(work, work.results[age], age)
        numbers = range(options.rounds) if options.round is None else range(options.round, options.round + 1)
        for said in rounds(chosen, folder, numbers, options.seed):
            defects += 1
            print(said, flush=True)
    print(f"{len(numbers)} rounds, {defects} defects")
    return 1 if defects else 0


if __name__ == "__main__":
    sys.exit(main())
