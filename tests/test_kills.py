"""Commands that are killed at any moment: each result is then the earlier one or the new one, whole.

SIGINT, SIGTERM and SIGHUP end a command silently, with the code that shells expect; after SIGKILL the same command
makes what it makes undisturbed. The environment variables ROUNDS and SEED say how often and how it is tried.
"""

import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time

import batch_runs
import numpy as np
import pytest
import toy

from gaussian_trimmer import formats
from gaussian_trimmer.io.writing import HIDDEN_PREFIX

pytestmark = pytest.mark.slow
ROUNDS, SEED = int(os.environ.get("ROUNDS", "6")), os.environ.get("SEED", "1")
READY = "ready"
COMMAND = f"import sys; from gaussian_trimmer.cli import main; print({READY!r}, flush=True); sys.exit(main())"
SIGNALS = (signal.SIGKILL,) * 3 + (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
QUICK = ["--set", "plan.size=96", "--views", "2", "--refine", "off", "--up", "z"]
COMMANDS = {
    "trim": ["trim", "scene.ply", "{age}.npy", "--output", "{out}/results", *QUICK, "--overwrite"],
    "select": ["select", "scene.ply", "--add", "{age}.npy", "--up", "z", "--output", "{out}/rows.npy", "--overwrite"],
    "batch": ["batch", "{age}.csv", "--output", "{out}/batch", "--workers", "1"],
}
"""Words of each, for a folder and for "old" or "new"."""
TIMES = {"report.json", "manifest.json", "summary.csv"}
"""What holds times, or sizes of files with times."""
MINE = {"mine.txt": b"mine"}


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    """A folder with a scene, and two selections and batches of it."""
    folder = tmp_path_factory.mktemp("kills")
    scene, truth = toy.ball_on_floor(n_ball=300, floor_side=16)
    formats.write(scene, folder / "scene.ply")
    for age, margin in (("old", 0.3), ("new", 0.4)):
        np.save(folder / f"{age}.npy", toy.dilated(scene, truth, margin))
        rows = [f"scene.ply,{age}.npy,scene-{k},z,{batch_runs.QUICK}" for k in range(4)]
        (folder / f"{age}.csv").write_text("\n".join(["scene,selection,name,up,options", *rows]) + "\n")
    return folder


def contents(folder):
    """All files of a folder but those with times, and hidden ones of a single file, which stay for a day."""
    paths = (path for path in folder.rglob("*") if path.is_file() and not path.name.startswith(f"{HIDDEN_PREFIX}-"))
    files = {path.relative_to(folder).as_posix(): path for path in paths}
    return {name: path.read_bytes() for name, path in files.items() if not TIMES.intersection(name.split("/"))}


def started(what, inputs, out, age):
    """The command, as soon as its own code begins."""
    words = [word.format(age=age, out=out) for word in COMMANDS[what]]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    process = subprocess.Popen([sys.executable, "-c", COMMAND, *words, "--quiet"], text=True, cwd=inputs, **pipes)
    assert process.stdout.readline() == f"{READY}\n", process.communicate()[1]
    return process


def finish(*what):
    """Run the command undisturbed; return the seconds that it takes."""
    process, begun = started(*what), time.monotonic()
    code, _, err = batch_runs.end(process, 600)
    assert (code, err) == (0, "")
    return time.monotonic() - begun


def item(name):
    """The result that a file belongs to: an item of a batch, or all there is."""
    return "/".join(name.split("/")[:3]) if name.startswith("batch/") else ""


@pytest.mark.parametrize("what", COMMANDS)
def test_what_a_killed_command_leaves_is_whole(what, inputs, tmp_path):
    for age in ("old", "new"):
        (tmp_path / age).mkdir()
        seconds = finish(what, inputs, tmp_path / age, age)
    new = MINE | contents(tmp_path / "new")
    for number in range(ROUNDS):
        rng, out = random.Random(f"{SEED}/{what}/{number}"), tmp_path / str(number)
        out.mkdir()
        if rng.random() < 0.5:
            shutil.copytree(tmp_path / "old", out, dirs_exist_ok=True)
        (out / "mine.txt").write_bytes(b"mine")
        before, killed_by, moment = contents(out), rng.choice(SIGNALS), rng.random()
        process = started(what, inputs, out, "new")
        if aimed := rng.random() < 0.5:  # at the moment when it begins to write
            while process.poll() is None and not any(out.rglob(".gaussian-trimmer*")):
                time.sleep(0.001)
        time.sleep(moment * (0.3 if aimed else seconds))
        process.send_signal(killed_by)
        code, _, err = batch_runs.end(process, 600)
        told = f"SEED={SEED}, round {number}: {killed_by.name}, code {code}: {err[-1000:]}"
        if killed_by == signal.SIGKILL or code == 0:
            finish(what, inputs, out, "new")
            assert contents(out) == new, told
        else:  # before a command takes the signals it has begun nothing
            assert code in (128 + killed_by, -killed_by), told
            assert re.fullmatch(r"(gaussian-trimmer: Stopped[^\n]*\n)?", err), told
            left = contents(out)
            for unit in map(item, {**before, **new}):
                now, old, made = ({n: d for n, d in files.items() if item(n) == unit} for files in (left, before, new))
                assert now in (old, made), f"{told}: '{unit}' is neither the earlier nor the new result"
        shutil.rmtree(out)
