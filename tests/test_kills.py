"""Commands and the app, killed at any moment: each result is then the earlier one or the new one, whole.

SIGINT, SIGTERM and SIGHUP end a command silently, with the code that shells expect; after SIGKILL the same command
makes what it makes undisturbed, and so does the app when it saves again. The environment variables ROUNDS and SEED say
how often and how it is tried.
"""

from __future__ import annotations

import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from contextlib import ExitStack, suppress

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
SCENE, CHOSEN = "{inputs}/scene.ply", "{inputs}/{age}"
BATCH = ["batch", f"{CHOSEN}.csv", "--output", "batch", "--workers", "1"]
COMMANDS = {
    "trim": ["trim", SCENE, f"{CHOSEN}.npy", "--output", "results", *QUICK, "--overwrite"],
    "select": ["select", SCENE, "--add", f"{CHOSEN}.npy", "--up", "z", "--output", "rows.npy", "--overwrite"],
    "batch": BATCH,
    "ray": [*BATCH, "--engine", "ray"],
    "objects": ["objects", f"{CHOSEN}.ply", "--output", "found", "--trim", "cut", "--keep", "1", *QUICK, "--overwrite"],
}
"""Words of each, to be said in the folder of the results, for "old" or "new"."""
TIMES = {"report.json", "manifest.json", "summary.csv", "objects.json"}
"""What holds times, or sizes of files with times."""
MINE = {"mine.txt": b"mine"}


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    """A folder with a scene, and two selections and batches of it."""
    folder = tmp_path_factory.mktemp("kills")
    scene, truth = toy.ball_on_floor(n_ball=300, floor_side=16)
    formats.write(scene, folder / "scene.ply")
    for age, margin in (("old", 0.3), ("new", 0.4)):
        formats.write(toy.ball_on_floor(seed=int(10 * margin), n_ball=300, floor_side=16)[0], folder / f"{age}.ply")
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
    words = [word.format(age=age, inputs=inputs) for word in COMMANDS[what]]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    process = subprocess.Popen([sys.executable, "-c", COMMAND, *words, "--quiet"], text=True, cwd=out, **pipes)
    assert process.stdout.readline() == f"{READY}\n", process.communicate()[1]
    return process


def finish(*what):
    """Run the command undisturbed; return the seconds that it takes."""
    process, begun = started(*what), time.monotonic()
    code, _, err = batch_runs.end(process, 600)
    assert (code, err) == (0, "")
    return time.monotonic() - begun


def item(name):
    """The result that a file belongs to: an item of a batch, a folder, or what lies in none."""
    parts = name.split("/")
    return "/".join(parts[:3] if parts[0] == "batch" else parts[:-1][:1])


def prepared(what, place, number, old):
    """A folder with the earlier results or none, and a file of the user's; what it holds, and what is random."""
    rng, out = random.Random(f"{SEED}/{what}/{number}"), place / str(number)
    out.mkdir()
    if rng.random() < 0.5:
        shutil.copytree(old, out, dirs_exist_ok=True)
    (out / "mine.txt").write_bytes(b"mine")
    return out, contents(out), rng


def wait_to_kill(process, out, rng, seconds):
    """Wait for any moment of a run of so many seconds; half of the time for one when it writes."""
    moment = rng.random()
    if aimed := rng.random() < 0.5:
        while process.poll() is None and not any(out.rglob(".gaussian-trimmer*")):
            time.sleep(0.001)
    time.sleep(moment * (0.3 if aimed else seconds))


def assert_whole(left, before, new, told):
    """Each result is the earlier or the new one."""
    for unit in map(item, {**before, **new}):
        now, old, made = ({n: d for n, d in files.items() if item(n) == unit} for files in (left, before, new))
        assert now in (old, made), f"{told}: '{unit}' is neither the earlier nor the new result"


@pytest.mark.parametrize("what", COMMANDS)
def test_what_a_killed_command_leaves_is_whole(what, inputs, tmp_path):
    if what == "ray":
        pytest.importorskip("ray")
    for age in ("old", "new"):
        (tmp_path / age).mkdir()
        seconds = finish(what, inputs, tmp_path / age, age)
    new = MINE | contents(tmp_path / "new")
    for number in range(ROUNDS):
        out, before, rng = prepared(what, tmp_path, number, tmp_path / "old")
        killed_by = rng.choice(SIGNALS)
        process = started(what, inputs, out, "new")
        wait_to_kill(process, out, rng, seconds)
        process.send_signal(killed_by)
        code, _, err = batch_runs.end(process, 600)
        told = f"SEED={SEED}, round {number}: {killed_by.name}, code {code}: {err[-1000:]}"
        if killed_by == signal.SIGKILL or code == 0:
            finish(what, inputs, out, "new")
            assert contents(out) == new, told
        else:  # before a command takes the signals it has begun nothing
            assert code in (128 + killed_by, -killed_by), told
            assert re.fullmatch(r"(gaussian-trimmer: Stopped[^\n]*\n)?", err), told
            assert_whole(contents(out), before, new, told)
        shutil.rmtree(out)


VIEW = {"eye": [0, -6, 3], "target": [0, 0, 1], "up": [0, 0, 1], "fov": 1.0, "width": 400, "height": 300}


class App:
    """The app in a process of its own, and what a tab says to it."""

    def __init__(self, scene, out, started):
        from websockets.sync.client import connect

        command = [sys.executable, "-m", "gaussian_trimmer", "view", scene, "--port", "0", "--no-browser", "--quiet"]
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
        self.process = subprocess.Popen(command, text=True, cwd=out, **pipes)
        started.append(self.process)
        address = self.process.stdout.readline().strip()
        assert address.startswith("http://"), self.process.communicate()[1]
        self.ends = ExitStack()
        wire = connect(f"ws{address.removeprefix('http')}socket", max_size=None)
        self.tab = self.ends.enter_context(wire)
        self.hear("Gaussians.")

    def say(self, kind, **more):
        """Tell the app something."""
        self.tab.send(json.dumps({"is": kind, "view": VIEW, **more}))

    def hear(self, words):
        """Wait until the app says these words as what it has done."""
        for message in self.tab:
            said = {} if isinstance(message, bytes) else json.loads(message).get("state", {})
            assert not said.get("wrong"), said
            if words in said.get("said", "") and said.get("share") is None:
                return
        raise AssertionError(f"The app never said '{words}'.")

    def save(self, selection):
        """Cut out what a file selects, and begin to save it."""
        self.say("enter", control="Selection", value=str(selection))
        self.say("do", action="Replace the marks by this file")
        self.hear("selected")
        self.say("do", action="Cut out")
        self.hear("object")
        self.say("enter", control="Folder", value="results")
        self.say("enter", control="Earlier results", value="Replace")
        self.say("do", action="Save in this folder")

    def end(self, killed_by=signal.SIGTERM):
        """End the app; return its code and what it said of errors."""
        self.process.send_signal(killed_by)
        code, _, err = batch_runs.end(self.process, 600)
        with suppress(Exception):
            self.ends.close()
        return code, err


@pytest.fixture
def begun():
    """Processes that a test begins; those that still run in its end are killed."""
    processes = []
    yield processes
    for process in processes:
        process.kill()


@pytest.mark.needs("starlette")
def test_what_the_app_saves_is_whole_if_it_is_killed(inputs, tmp_path, begun):
    def save(out, age):
        app = App(inputs / "scene.ply", out, begun)
        app.save(inputs / f"{age}.npy")
        start = time.monotonic()
        app.hear("Saved in")
        seconds = time.monotonic() - start
        assert app.end()[0] == 128 + signal.SIGTERM
        return seconds

    for age in ("old", "new"):
        (tmp_path / age).mkdir()
        seconds = save(tmp_path / age, age)
    new = MINE | contents(tmp_path / "new")
    for number in range(ROUNDS):
        out, before, rng = prepared("app", tmp_path, number, tmp_path / "old")
        killed_by = rng.choice((signal.SIGKILL, signal.SIGKILL, signal.SIGTERM))
        app = App(inputs / "scene.ply", out, begun)
        app.save(inputs / "new.npy")
        wait_to_kill(app.process, out, rng, seconds)
        code, err = app.end(killed_by)
        told = f"SEED={SEED}, round {number}: {killed_by.name}, code {code}: {err[-1000:]}"
        assert code == (-killed_by if killed_by == signal.SIGKILL else 128 + killed_by), told
        if killed_by == signal.SIGKILL:
            save(out, "new")
            assert contents(out) == new, told
        else:
            assert_whole(contents(out), before, new, told)
        shutil.rmtree(out)
