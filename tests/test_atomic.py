"""Files and folders of results appear whole, or not at all, and replace what the program wrote and nothing else."""

import errno
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from processes import end, holding, needs_fork

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.io.atomic import locks
from gaussian_trimmer.io.writing import atomic_file, atomic_folder


def fill(folder, **contents):
    for name, text in contents.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)


def write(folder, kind="test", *, overwrite=True, **contents):
    """One whole run."""
    with atomic_folder(folder, kind, overwrite=overwrite) as part:
        fill(part, **contents)


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def refused(folder, kind="test", match="", **options):
    with pytest.raises(InputError, match=match) as raised, atomic_folder(folder, kind, **options):
        pytest.fail("the folder was opened")
    assert "\n" not in str(raised.value)


def test_new_folder_appears_with_its_parents_when_all_is_written(tmp_path):
    target = tmp_path / "a" / "b"
    with atomic_folder(target, "test") as folder:
        fill(folder, one="1")
        assert not target.parent.exists()
    assert names(target) == ["manifest.json", "one"]
    assert names(tmp_path) == ["a"]


def test_nothing_is_left_of_a_failure(tmp_path):
    with pytest.raises(KeyboardInterrupt), atomic_folder(tmp_path / "a" / "b", "test") as folder:
        fill(folder, one="1")
        raise KeyboardInterrupt
    with pytest.raises(RuntimeError), atomic_file(tmp_path / "file") as part:
        part.write_text("1")
        raise RuntimeError
    assert names(tmp_path) == []


def test_failure_keeps_earlier_results(tmp_path):
    write(tmp_path, one="old")
    with pytest.raises(RuntimeError), atomic_folder(tmp_path, "test", overwrite=True) as folder:
        fill(folder, one="new")
        raise RuntimeError
    assert (tmp_path / "one").read_text() == "old"
    assert names(tmp_path) == ["manifest.json", "one"]


def test_empty_folder_is_used_as_it_is(tmp_path):
    inode = tmp_path.stat().st_ino
    write(tmp_path, one="1", overwrite=False)
    assert names(tmp_path) == ["manifest.json", "one"]
    assert tmp_path.stat().st_ino == inode


def test_manifest_lists_what_was_written(tmp_path):
    write(tmp_path, **{"one": "1", "views/0": "four"})
    assert json.loads((tmp_path / "manifest.json").read_text())["files"] == {"one": 1, "views/0": 4}


def test_overwriting_replaces_earlier_results_and_keeps_the_rest(tmp_path):
    write(tmp_path, **{"one": "old", "stale": "old", "views/0": "old", "views/1": "old", "gone/0": "old"})
    fill(tmp_path, **{"notes": "mine", "views/photo": "mine", "one.blend": "mine"})
    write(tmp_path, **{"one": "new", "views/0": "new"})
    assert names(tmp_path) == ["manifest.json", "notes", "one", "one.blend", "views"]
    assert names(tmp_path / "views") == ["0", "photo"]
    assert (tmp_path / "one").read_text() == (tmp_path / "views" / "0").read_text() == "new"


def test_a_result_that_the_user_changed_is_the_users(tmp_path):
    write(tmp_path, one="old", two="old", three="old")
    fill(tmp_path, two="edited", three="edited")
    with pytest.raises(InputError, match="has changed since"):
        write(tmp_path, one="new", two="new")
    assert [(tmp_path / name).read_text() for name in ("one", "two", "three")] == ["old", "edited", "edited"]
    (tmp_path / "two").unlink()
    write(tmp_path, one="new", two="new")
    assert [(tmp_path / name).read_text() for name in ("one", "two", "three")] == ["new", "new", "edited"]


@pytest.mark.parametrize("name", ["one", "views/0", "manifest.json"])
def test_a_strangers_file_in_the_way_is_refused_and_stays(tmp_path, name):
    fill(tmp_path, **{name: "mine"})
    with pytest.raises(InputError, match=rf"{name}' is in the way of a result.*choose another"):
        write(tmp_path, **{"one": "new", "views/0": "new"})
    assert (tmp_path / name).read_text() == "mine"
    assert sum(path.is_file() for path in tmp_path.rglob("*")) == 1


def test_what_is_in_the_way_is_found_at_once_where_names_are_known(tmp_path):
    fill(tmp_path, **{"views/07.png": "mine"})
    refused(tmp_path, match="07.png' is in the way", names=["object.ply", "views/[0-9][0-9].png"], overwrite=True)
    (tmp_path / "views" / "07.png").unlink()
    (tmp_path / "object.ply").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(InputError, match="in the way"):
        write(tmp_path, **{"object.ply": "new"})


def test_folders_that_are_links_lead_nowhere(tmp_path):
    (tmp_path / "elsewhere").mkdir()
    out = tmp_path / "out"
    write(out, **{"views/0": "old"})
    (out / "views" / "0").rename(tmp_path / "elsewhere" / "0")
    (out / "views").rmdir()
    (out / "views").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(InputError, match="is a link or a file"):
        write(out, **{"views/0": "new"})
    write(out, one="new")
    assert (tmp_path / "elsewhere" / "0").read_text() == "old"


def test_results_of_another_kind_are_not_replaced(tmp_path):
    write(tmp_path, "trim", one="old")
    refused(tmp_path, "views", match="results of 'trim', which 'views' does not replace", overwrite=True)


@pytest.mark.parametrize("name", ["../mine", "/mine", "views/../../mine", "C:mine", "", ".", "manifest.json", "a//b"])
def test_manifest_that_names_files_elsewhere_is_none(tmp_path, name):
    out = tmp_path / "out"
    fill(tmp_path, mine="mine")
    write(out, one="old")
    manifest = json.loads((out / "manifest.json").read_text())
    (out / "manifest.json").write_text(json.dumps({**manifest, "files": {name: 4, "one": 3}}))
    with pytest.raises(InputError, match="is in the way"):
        write(out, one="new")
    assert (tmp_path / "mine").read_text() == "mine"
    assert (out / "one").read_text() == "old"


@pytest.mark.parametrize("text", ["", "[]", "{}", "[" * 100_000, '{"program": "gaussian-trimmer", "files": []}'])
def test_damaged_manifest_is_none(tmp_path, text):
    write(tmp_path, one="old")
    (tmp_path / "manifest.json").write_text(text)
    with pytest.raises(InputError, match="is in the way"):
        write(tmp_path, two="new")
    assert names(tmp_path) == ["manifest.json", "one"]


def test_an_input_is_never_replaced(tmp_path):
    out = tmp_path / "out"
    write(out, **{"object.ply": "old", "views/0": "old"})
    (tmp_path / "link").symlink_to(out / "object.ply")
    for given in (out / "object.ply", tmp_path / "link", out / "views"):
        refused(out, match="is an input of this run", inputs=[given], overwrite=True)
    (tmp_path / "link").unlink()
    fill(out, scene="mine")
    with atomic_folder(out, "test", inputs=[out / "scene", tmp_path / "missing", tmp_path], overwrite=True) as part:
        fill(part, **{"object.ply": "new"})
    assert names(out) == ["manifest.json", "object.ply", "scene"]


def test_folder_that_holds_something_is_refused(tmp_path):
    fill(tmp_path, notes="mine")
    refused(tmp_path, match=r"not empty.*--overwrite")


def test_file_in_the_way_is_refused(tmp_path):
    fill(tmp_path, results="a file")
    refused(tmp_path / "results", match="is a file", overwrite=True)
    refused(tmp_path / "results" / "below", match=r"is a file; choose another")


def test_what_comes_to_the_folder_meanwhile_stays(tmp_path):
    out = tmp_path / "out"
    with pytest.raises(InputError, match="meanwhile"), atomic_folder(out, "test") as part:
        fill(part, one="new")
        fill(out, notes="mine")
    with pytest.raises(InputError, match="in the way"), atomic_folder(out, "test", overwrite=True) as part:
        fill(part, one="new")
        fill(out, one="mine")
    assert names(out) == ["notes", "one"]
    assert (out / "one").read_text() == "mine"


def test_names_of_folders_may_be_long(tmp_path):
    write(tmp_path / ("n" * 255), one="1")
    with atomic_file(tmp_path / ("f" * 255)) as part:
        part.write_text("1")
    assert names(tmp_path) == ["f" * 255, "n" * 255]


def test_file_keeps_its_old_contents_where_the_disk_fails_at_the_last_moment(tmp_path, monkeypatch):
    fill(tmp_path, one="old")

    def full(descriptor):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(InputError, match="No space left"), atomic_file(tmp_path / "one") as part:
        part.write_text("new")
    with pytest.raises(InputError, match="No space left"):
        write(tmp_path / "out", one="new")
    monkeypatch.undo()
    assert names(tmp_path) == ["one"]
    assert (tmp_path / "one").read_text() == "old"


def test_file_system_without_fsync_and_locks_still_works(tmp_path, monkeypatch):
    def missing(*_):
        raise OSError(errno.ENOTSUP, "Operation not supported")

    monkeypatch.setattr(os, "fsync", missing)
    monkeypatch.setattr(locks, "_lock", missing)
    with atomic_file(tmp_path / "file") as part:
        part.write_text("1")
    write(tmp_path / "out", one="old")
    with atomic_folder(tmp_path / "out", "test", overwrite=True) as part:
        fill(part, one="new")
        refused(tmp_path / "out", match="Another run is writing", overwrite=True)
        lock = tmp_path / "out" / ".gaussian-trimmer.part" / "lock"
        process = lock.read_text()
        lock.write_text(process + "-elsewhere")
        refused(tmp_path / "out", match="Another run is writing", overwrite=True)
    assert (tmp_path / "out" / "one").read_text() == "new"
    (tmp_path / "out" / ".gaussian-trimmer.part").mkdir()
    dead = 2**22 + 1  # above any process number
    lock.write_text(process.replace(process.split()[0], str(dead)))
    write(tmp_path / "out", one="newer")
    assert names(tmp_path / "out") == ["manifest.json", "one"]


def test_parts_of_strangers_are_not_followed(tmp_path):
    """A folder from elsewhere may hold what looks like the part of a dead run."""
    (tmp_path / "precious").mkdir()
    fill(tmp_path / "precious", mine="mine")
    out = tmp_path / "out"
    out.mkdir()
    part = out / ".gaussian-trimmer.part"
    part.symlink_to(tmp_path / "precious")
    refused(out, match="is a link")
    part.unlink()
    part.mkdir()
    (part / "old").symlink_to(tmp_path / "precious")
    (part / "journal.json").write_text(json.dumps({"going": ["mine"], "coming": {}, "made": []}))
    refused(out, match="damaged")
    (part / "journal.json").write_text(json.dumps({"going": ["../precious/mine"], "coming": {}, "made": []}))
    refused(out, match="damaged")
    (part / "journal.json").unlink()
    write(out, one="1")
    assert names(out) == ["manifest.json", "one"]
    assert names(tmp_path / "precious") == ["mine"]


@needs_fork
def test_second_run_into_a_folder_is_refused_at_once(tmp_path):
    new, old, deep = tmp_path / "new", tmp_path / "old", tmp_path / "a" / "b"
    write(old, one="old")
    for folder in (new, old, deep):
        child = holding(atomic_folder(folder, "test", overwrite=True))
        try:
            refused(folder, match="Another run is writing", overwrite=True)
            if folder == deep:  # what lies farther up has the lock now
                deep.parent.mkdir()
                refused(deep, match="Another run is writing")
            write(tmp_path / "other", one="1")  # another folder, and the leftovers of the living stay
        finally:
            os.kill(child, signal.SIGKILL)
        assert end(child) == -signal.SIGKILL
        write(folder, one="new")
        assert names(folder) == ["manifest.json", "one"]
    assert names(tmp_path) == ["a", "new", "old", "other"]
    assert names(deep.parent) == ["b"]


@needs_fork
def test_leftovers_of_dead_runs_are_removed_and_those_of_living_ones_are_not(tmp_path):
    for context in (atomic_folder(tmp_path / "new", "test"), atomic_file(tmp_path / "file")):
        child = holding(context)
        try:
            with atomic_file(tmp_path / "other") as part:
                part.write_text("1")
            assert len(names(tmp_path)) == 2
        finally:
            os.kill(child, signal.SIGKILL)
        end(child)
        assert len(names(tmp_path)) == 2
        with atomic_file(tmp_path / "other") as part:
            part.write_text("1")
        assert names(tmp_path) == ["other"]


@needs_fork
def test_folder_of_a_killed_run_counts_as_empty(tmp_path):
    child = holding(atomic_folder(tmp_path, "test"))
    os.kill(child, signal.SIGKILL)
    end(child)
    assert names(tmp_path) == [".gaussian-trimmer.part"]
    write(tmp_path, overwrite=False, one="1")
    assert names(tmp_path) == ["manifest.json", "one"]


WINDOWS = """
import fcntl, sys, types
from pathlib import Path

def locking(descriptor, mode, size):
    try: fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError: raise OSError(36, "Resource deadlock avoided")

sys.platform, sys.modules["fcntl"] = "win32", None
sys.modules["msvcrt"] = types.SimpleNamespace(locking=locking, LK_NBLCK=2)
from gaussian_trimmer.io.writing import atomic_file, atomic_folder

for overwrite in (False, True):
    with atomic_folder(Path("out"), "test", overwrite=overwrite) as part:
        with atomic_file(part / "one") as file:
            file.write_text("1")
        try:
            with atomic_folder(Path("out"), "test", overwrite=True):
                raise AssertionError
        except ValueError as error:
            assert "Another run" in str(error)
"""


@pytest.mark.skipif(os.name != "posix", reason="plays Windows by what other systems have")
def test_windows_has_locks_of_its_own(tmp_path):
    environment = {**os.environ, "PYTHONPATH": str(Path(locks.__file__).parents[2])}
    subprocess.run([sys.executable, "-c", WINDOWS], check=True, cwd=tmp_path, env=environment)
    assert names(tmp_path) == ["out"]
    assert names(tmp_path / "out") == ["manifest.json", "one"]
