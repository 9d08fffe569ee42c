"""Two users who write to the same folder: neither replaces or moves the other's files, and each is told what to do."""

import os
import signal
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

if not hasattr(os, "geteuid") or os.geteuid() != 0:
    pytest.skip("only root can act as two users", allow_module_level=True)

ANN, BOB = 54321, 54322
PREPARE = """
import encodings.ascii, os, signal, sys, time
from pathlib import Path
from tempfile import TemporaryDirectory
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.io.folders import atomic_folder, remove_leftovers
from gaussian_trimmer.io.writing import write_whole
out, word = Path(sys.argv[1]), sys.argv[2]
with TemporaryDirectory() as state:  # imports what another user may not be able to import any more
    os.environ["XDG_STATE_HOME"] = state
    with atomic_folder(Path(state, "out"), "trim"):
        pass
    del os.environ["XDG_STATE_HOME"]
os.umask(0o022)
os.setgroups([])
os.setgid(int(word))
os.setuid(int(word))
os.chdir(out)

def write(killed_after=None):
    moved, rename = [], Path.rename
    def renamed(path, goal):
        if len(moved) == killed_after:
            os.kill(os.getpid(), signal.SIGKILL)
        moved.append(goal)
        return rename(path, goal)
    Path.rename = renamed
    with atomic_folder(out, "trim", overwrite=True) as results:
        for name in ("object.ply", "views/0.png"):
            (results / name).parent.mkdir(exist_ok=True)
            (results / name).write_text(word)
try:
    DO
except InputError as error:
    sys.exit(f"refused: {error}")
"""


@pytest.fixture
def shared():
    """A folder that both can write to, and homes of their own beside it."""
    with TemporaryDirectory() as parent:
        place = Path(parent)
        place.chmod(0o755)
        for name, owner, mode in (("ann", ANN, 0o700), ("bob", BOB, 0o700), ("shared", 0, 0o1777)):
            (place / name).mkdir()
            os.chown(place / name, owner, owner)
            (place / name).chmod(mode)
        yield place / "shared"


def begin(user, folder, do, home=None):
    """Let a process that becomes a user do something in the folder, with the user's number as what files hold."""
    home = folder.parent / (home or {ANN: "ann", BOB: "bob"}[user])
    environment = {name: value for name, value in os.environ.items() if name != "XDG_STATE_HOME"}
    command = [sys.executable, "-c", PREPARE.replace("DO", do), str(folder), str(user)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.Popen(command, env=environment | {"HOME": str(home)}, text=True, **pipes)


def act(user, folder, do="write()", home=None):
    """Do something to its end; return the code and what is said of errors."""
    process = begin(user, folder, do, home)
    _, said = process.communicate(timeout=120)
    assert "Traceback" not in said, said
    return process.returncode, said


def contents(folder):
    """All files but locks, by name."""
    paths = (path for path in folder.rglob("*") if path.is_file() and path.suffix != ".lock")
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}


def test_results_of_another_user_are_not_replaced_and_the_cure_is_said(shared):
    assert act(ANN, shared) == (0, "")
    before = contents(shared)
    code, said = act(BOB, shared)
    assert code == 1 and "in the way" in said and "choose another output folder" in said
    assert contents(shared) == before
    assert act(ANN, shared) == (0, "")


def test_what_another_users_dead_run_left_stays_for_that_user(shared):
    assert act(ANN, shared) == (0, "")
    assert act(ANN, shared, "write(killed_after=4)")[0] == -signal.SIGKILL
    left = contents(shared)
    for do in ("write()", "remove_leftovers(out)", "write_whole(out / 'scene.spz', b'mine')"):
        act(BOB, shared, do)
        assert left.items() <= contents(shared).items()
    (shared / "scene.spz").unlink()
    assert act(ANN, shared) == (0, "")
    assert {*contents(shared)} == {"object.ply", "views/0.png", "manifest.json"}
    assert not [*shared.glob(".gaussian-trimmer*.part")]


@pytest.mark.parametrize("user", [ANN, BOB])
def test_a_lock_that_another_user_holds_or_left_is_named(shared, user):
    folder, other = shared / "a", ANN + BOB - user
    folder.mkdir()
    folder.chmod(0o777)
    process = begin(user, folder, "with atomic_folder(out, 'trim'):\n        print(flush=True); time.sleep(600)")
    assert process.stdout.readline() == "\n", process.communicate()
    locked = f"{folder}/.gaussian-trimmer.lock' is the lock of another user's run"
    code, said = act(other, folder)
    assert code == 1 and locked in said and "wait until it ends" in said
    process.kill()
    process.communicate()
    code, said = act(other, folder)
    assert code == 1 and locked in said and "delete the lock" in said
    assert act(user, folder) == (0, "")  # and takes its own lock away
    assert [*contents(folder)] and not (folder / ".gaussian-trimmer.lock").exists()


def test_a_home_of_another_user_is_neither_read_nor_spoilt(shared):
    """As after `sudo` that keeps HOME: nothing can be kept there, but results are made."""
    assert act(ANN, shared) == (0, "")
    own = contents(shared.parent / "ann")
    code, said = act(BOB, shared, "write_whole(out / 'a.spz', b'mine')", home="ann")
    assert (code, said) == (0, "")
    code, said = act(BOB, shared, home="ann")
    assert code == 1 and "in the way" in said
    assert contents(shared.parent / "ann") == own
