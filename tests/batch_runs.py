"""Batches of toy scenes, the command that runs them as a process of its own, and its workers."""

import csv
import math
import os
import re
import signal
import statistics
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import toy

import gaussian_trimmer
from gaussian_trimmer import formats

QUICK = "--plan.size 96 --views 2"
SLOW = "--plan.size 256 --views 4"
ENDLESS = "--plan.size 4096 --views 100"


def save_scenes(folder, n_scenes=3, n_objects=3):
    """Scenes s0.ply, ... with selections s0-0.npy, ...; returns the names of the items."""
    names = []
    for s in range(n_scenes):
        scene, truth = toy.ball_on_floor(seed=s)
        formats.write(scene, folder / f"s{s}.ply")
        for k in range(n_objects):
            np.save(folder / f"s{s}-{k}.npy", toy.dilated(scene, truth, 0.3 + 0.1 * k))
            names.append(f"s{s}-{k}")
    return names


def write_manifest(folder, names, options=QUICK, file="manifest.csv", **others):
    """A manifest of items like those of `save_scenes`; `others` are options of single items, `-` in names being `_`."""
    rows = ["scene,selection,name,up,options"]
    for name in names:
        chosen = others.get(name.replace("-", "_"), options)
        rows.append(f"{name.split('-')[0]}.ply,{name}.npy,{name},z,{chosen}")
    (folder / file).write_text("\n".join(rows) + "\n")
    return folder / file


def start(manifest, output, *options, **environment):
    """Start the command; returns the process."""
    source = str(Path(gaussian_trimmer.__file__).parents[1])
    command = [sys.executable, "-m", "gaussian_trimmer", "batch", str(manifest), "--output", str(output)]
    return subprocess.Popen(
        [*command, *map(str, options)], text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": source, **environment},
    )  # fmt: skip


def end(process, timeout=240):
    """Exit code, output and errors of a process, which is killed if it does not end."""
    try:
        out, err = process.communicate(timeout=timeout)
    except subprocess.TimeoutExpired:
        process.kill()
        raise
    return process.returncode, out, err


def run(manifest, output, *options, **environment):
    """Run the command to its end; returns exit code, output and errors."""
    return end(start(manifest, output, *options, **environment))


def generous_limit(output, times=20.0, least=10.0):
    """A time limit in seconds that no item like those of a run comes near, however slow the machine is."""
    with (output / "summary.csv").open() as file:
        typical = statistics.median(float(row["seconds"]) for row in csv.DictReader(file))
    return math.ceil(max(least, times * typical))


def fresh_of(out):
    """How many items a run says that it has trimmed itself."""
    done, earlier = re.search(r"^(\d+) of \d+ items are finished(?:, (\d+) of them by)?", out, re.MULTILINE).groups()
    return int(done) - int(earlier or 0)


def contents(output):
    """All files of the items, by path."""
    root = output / "items"
    return {p.relative_to(root).as_posix(): p.read_bytes() for p in root.rglob("*") if p.is_file()}


def identities(output):
    """Inode and time of all files of the items: what is the same has not been written again."""
    root = output / "items"
    files = {path: path.stat() for path in root.rglob("*") if path.is_file() and ".part" not in str(path)}
    return {path.relative_to(root).as_posix(): (found.st_ino, found.st_mtime_ns) for path, found in files.items()}


def until(condition, seconds=120.0, pause=0.002):
    """What a function returns as soon as that is true."""
    end_of_patience = time.monotonic() + seconds
    while time.monotonic() < end_of_patience:
        if found := condition():
            return found
        time.sleep(pause)
    raise AssertionError("what was waited for has not come")


def children(process):
    """Numbers of the processes that a process has started."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[1]) == process.pid and fields[0] != "Z":
            found.append(int(path.parent.name))
    return found


def is_alive(number):
    """Whether there is a process with that number that has not ended."""
    try:
        return Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def parts(output):
    """Folders of results that are being written, or were when their process died."""
    try:
        return [p for p in output.rglob(".gaussian-trimmer*.part") if p.is_dir()]
    except OSError:
        return []


def is_trimming(output):
    """Whether a worker has begun an item and written nothing of it."""
    try:
        return any((p / "new").is_dir() and not any((p / "new").iterdir()) for p in parts(output))
    except OSError:
        return False


def is_writing(output):
    """Whether a worker has written some of an item's files, and not all."""
    try:
        return any((p / "new" / "labels.npz").exists() and not (p / "new" / "report.json").exists()
                   for p in parts(output))  # fmt: skip
    except OSError:
        return False


def n_finished(output):
    """Number of items that are there."""
    return len(list(output.glob("items/*/item.json")))


def kill(number, how=signal.SIGKILL):
    """Send a process a signal."""
    os.kill(number, how)
