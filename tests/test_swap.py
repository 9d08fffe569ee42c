"""Whatever stops a run, and whenever: a folder of results holds the earlier result or the new one."""

import os
import shutil
import signal
from itertools import count

import pytest
from processes import CHANGES, counted, end, needs_fork, signal_at, start

from gaussian_trimmer import cli
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.io.writing import atomic_file, atomic_folder

RESULTS = {
    "old": {"object.splat": "old", "report.json": "old", "views/0": "old", "views/1": "old"},
    "new": {"object.ply": "new", "report.json": "newer", "views/0": "new", "more/0": "new"},
}
MINE = {"notes": "mine", "views/photo": "mine"}
MOVES = ("rename", "replace")

pytestmark = needs_fork


@pytest.fixture(autouse=True)
def no_waiting_for_disks(monkeypatch):
    """No test takes the power away, so the disk need not be waited for."""
    monkeypatch.setattr(os, "fsync", lambda descriptor: None)


def fill(folder, contents):
    for name, text in contents.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)


def write(folder, which):
    with atomic_folder(folder, "test", overwrite=True) as part:
        fill(part, RESULTS[which])


def contents(folder):
    """Texts of the files in a folder, the manifest and what is hidden left out."""
    paths = [path for path in folder.rglob("*") if path.is_file()]
    shown = {path.relative_to(folder).as_posix(): path.read_text() for path in paths if path.name != "manifest.json"}
    return {name: text for name, text in shown.items() if not name.startswith(".")}


def leftovers(folder):
    return [path.name for path in folder.rglob(".*")]


def earlier(place, kind):
    """A folder to write to: with an earlier result and files of the user, empty, or not there."""
    folder = place / "a" / "out"
    place.mkdir(exist_ok=True)
    if kind == "earlier":
        write(folder, "old")
        fill(folder, MINE)
    elif kind == "empty":
        folder.mkdir(parents=True)
    return folder


STATES = {
    "earlier": ({**RESULTS["old"], **MINE}, {**RESULTS["new"], **MINE}),
    "empty": ({}, RESULTS["new"]),
    "new": ({}, RESULTS["new"]),
}


def run(folder, act, functions):
    """Write the new result in a command, as `main` runs one; returns the exit code, and the calls that were counted."""
    calls, _ = counted(act, functions)

    def command(arguments):
        write(folder, "new")
        return 0

    cli._dispatch = command
    return cli.main([]), calls


@pytest.mark.parametrize("kind", STATES)
def test_killed_at_any_moment_the_next_run_finds_the_old_result_or_the_new(tmp_path, kind):
    seen = []
    for k in count(1):
        place = tmp_path / str(k)
        folder = earlier(place, kind)
        child = start(lambda folder=folder, k=k: run(folder, signal_at(k, signal.SIGKILL), CHANGES)[0])
        status = end(child)
        with pytest.raises(RuntimeError), atomic_folder(folder, "test", overwrite=True):
            raise RuntimeError
        assert contents(folder) in STATES[kind]
        assert leftovers(place) == []
        seen.append(contents(folder))
        shutil.rmtree(place)
        if status == 0:
            break
        assert status == -signal.SIGKILL
    assert (seen[0], seen[-1]) == STATES[kind]
    assert k > 15


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_stopped_at_any_moment_a_run_leaves_the_old_result_or_the_new_and_nothing_else(tmp_path, number):
    for k in count(1):
        place = tmp_path / str(k)
        folder = earlier(place, "earlier")

        def work(folder=folder, k=k):
            code, calls = run(folder, signal_at(k, number), MOVES)
            return code if len(calls) >= k else 99

        status = end(start(work))
        assert contents(folder) in STATES["earlier"]
        assert leftovers(place) == []
        shutil.rmtree(place)
        if status == 99:
            break
        assert status == 128 + number
    assert k > 8


@pytest.mark.parametrize("kind", STATES)
@pytest.mark.parametrize("error", [PermissionError, KeyboardInterrupt])
def test_move_that_fails_is_undone(tmp_path, kind, error):
    for k in count(1):
        place = tmp_path / str(k)
        folder = earlier(place, kind)

        def fail(call, k=k):
            if call == k:
                raise error(13, "Permission denied")

        calls, restore = counted(fail, MOVES)
        try:
            write(folder, "new")
        except (InputError, KeyboardInterrupt) as raised:
            assert error is KeyboardInterrupt or "Permission denied" in str(raised)
            assert contents(folder) == STATES[kind][0]
        else:
            assert contents(folder) == STATES[kind][1]
        finally:
            restore()
        assert leftovers(place) == []
        if len(calls) < k:
            break
    assert k > 1


def test_what_cannot_be_moved_back_now_is_moved_back_by_the_next_run(tmp_path):
    for k in count(2):
        folder = earlier(tmp_path / str(k), "earlier")

        def fail(call, k=k):
            if call >= k:
                raise PermissionError(13, "Permission denied")

        calls, restore = counted(fail, MOVES)
        try:
            write(folder, "new")
        except InputError as raised:
            message = str(raised)
        finally:
            restore()
        if len(calls) < k:
            break
        assert "cannot be moved back" in message or contents(folder) == STATES["earlier"][0]
        with pytest.raises(RuntimeError), atomic_folder(folder, "test", overwrite=True):
            raise RuntimeError
        assert contents(folder) == STATES["earlier"][0]
        assert leftovers(folder) == []


def test_killed_while_it_undoes_a_swap_the_next_run_goes_on(tmp_path):
    for k in count(1):
        folder = earlier(tmp_path / str(k), "earlier")
        assert end(start(lambda folder=folder: run(folder, signal_at(8, signal.SIGKILL), MOVES)[0])) < 0
        assert contents(folder) not in STATES["earlier"]
        status = end(start(lambda folder=folder, k=k: run(folder, signal_at(k, signal.SIGKILL), MOVES)[0]))
        with pytest.raises(RuntimeError), atomic_folder(folder, "test", overwrite=True):
            raise RuntimeError
        assert contents(folder) in STATES["earlier"]
        if status == 0:
            break


def test_a_file_that_came_in_place_of_one_that_was_moved_is_kept(tmp_path):
    folder = earlier(tmp_path, "earlier")
    assert end(start(lambda: run(folder, signal_at(11, signal.SIGKILL), MOVES)[0])) < 0
    assert "object.splat" not in contents(folder)
    fill(folder, {"object.splat": "restored by hand"})
    with pytest.raises(InputError, match=r"there is another 'object\.splat' now"):
        write(folder, "new")
    assert contents(folder)["object.splat"] == "restored by hand"
    (folder / "object.splat").unlink()
    write(folder, "new")
    assert contents(folder) == STATES["earlier"][1]


def test_file_is_old_or_new_at_any_moment(tmp_path):
    path = tmp_path / "file"
    for k in count(1):
        path.write_text("old")

        def work(k=k):
            counted(signal_at(k, signal.SIGKILL))
            with atomic_file(path) as part:
                part.write_text("new")

        status = end(start(work))
        assert path.read_text() in ("old", "new")
        if status == 0:
            break
    with atomic_file(path) as part:
        part.write_text("new")
    assert list(tmp_path.iterdir()) == [path]
