"""Batches of toy scenes: their files, a batch without processes, and the command as a process of its own."""

import os
import re
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import toy

import gaussian_trimmer
from gaussian_trimmer import formats

QUICK = "--set plan.size=96 --views 2 --refine off"
SLOW = "--set plan.size=256 --views 4 --refine off"


def save_scenes(folder, n_scenes=2, n_objects=2):
    """Scenes s0.ply, ... with selections s0-0.npy, ...; returns the names of the items."""
    names = []
    for s in range(n_scenes):
        scene, truth = toy.ball_on_floor(seed=s)
        formats.write(scene, folder / f"s{s}.ply")
        for k in range(n_objects):
            np.save(folder / f"s{s}-{k}.npy", toy.dilated(scene, truth, 0.3 + 0.1 * k))
            names.append(f"s{s}-{k}")
    return names


def write_manifest(folder, names, options=QUICK, file="manifest.csv"):
    """A manifest of items like those of `save_scenes`."""
    rows = [f"{name.split('-')[0]}.ply,{name}.npy,{name},z,{options}" for name in names]
    (folder / file).write_text("\n".join(["scene,selection,name,up,options", *rows]) + "\n")
    return folder / file


def inline(function, tasks, workers=None):
    """In place of `on_processes`: calls the function in this process."""
    yield from ((number, function(*task)) for number, task in enumerate(tasks))


def start(manifest, output, *options):
    """Start the command; returns the process."""
    source = str(Path(gaussian_trimmer.__file__).parents[1])
    command = [sys.executable, "-m", "gaussian_trimmer", "batch", str(manifest), "--output", str(output)]
    return subprocess.Popen(
        [*command, *map(str, options)],
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": source},
    )


def end(process, timeout=240):
    """Exit code, output and errors of a process, which is killed if it does not end."""
    try:
        out, err = process.communicate(timeout=timeout)
    except subprocess.TimeoutExpired:
        process.kill()
        raise
    return process.returncode, out, err


def run(manifest, output, *options):
    """Run the command to its end; returns exit code, output and errors."""
    return end(start(manifest, output, *options))


def fresh_of(out):
    """How many items a run says that it has trimmed itself."""
    done, earlier = re.search(r"^(\d+) of \d+ done(?: \((\d+) earlier\))?", out, re.MULTILINE).groups()
    return int(done) - int(earlier or 0)


TIMED = ("report.json", "manifest.json", "summary.csv")
"""Results that hold times, or depend on them."""


def contents(output):
    """All files of the items, by path, but those that hold times."""
    root = output / "items"
    files = (path for path in root.rglob("*") if path.is_file() and path.name not in TIMED)
    return {path.relative_to(root).as_posix(): path.read_bytes() for path in files}


def until(condition, seconds=120.0):
    """What a function returns as soon as that is true."""
    end_of_patience = time.monotonic() + seconds
    while time.monotonic() < end_of_patience:
        if found := condition():
            return found
        time.sleep(0.01)
    raise AssertionError("what was waited for has not come")


def workers_of(process):
    """Numbers of the workers that a batch has started."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(")")[2].split()
            is_worker = b"spawn_main" in (path.parent / "cmdline").read_bytes()
        except OSError:
            continue
        if int(fields[1]) == process.pid and fields[0] != "Z" and is_worker:
            found.append(int(path.parent.name))
    return found


def is_alive(number):
    """Whether there is a process with that number that has not ended."""
    try:
        return Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def parts(output):
    """What is being written, or was when its process died."""
    # Unlike rglob, walk does not mind a folder that is finished meanwhile.
    names = [Path(folder, name) for folder, folders, files in os.walk(output) for name in (*folders, *files)]
    return [path for path in names if path.name.startswith(".gaussian-trimmer") and ".part" in path.name]


def n_finished(output):
    """Number of items that are there."""
    return len(list(output.glob("items/*/report.json")))
