"""Files and folders of results appear whole or not at all, and replace what the program wrote and nothing else."""

import errno
import json
import os
import signal
import stat
import subprocess
import sys
from itertools import count
from pathlib import Path

import pytest

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.io.folders import atomic_folder, earlier_results, remove_leftovers
from gaussian_trimmer.io.writing import atomic_file, state_folder

OLD = {"object.splat": "old", "report.json": "old", "views/0": "old", "views/1": "old"}
NEW = {"object.ply": "new", "report.json": "newer", "views/0": "new", "more/0": "new"}
MINE = {"notes": "mine", "views/photo": "mine"}

KILLED = """
import json, os, pathlib, shutil, signal, sys
from gaussian_trimmer.io.folders import atomic_folder
left = int(sys.argv[2])
def killing(function):
    def call(*arguments, **options):
        global left
        left -= 1
        if left == 0:
            os.kill(os.getpid(), signal.SIGKILL)
        return function(*arguments, **options)
    return call
pathlib.Path.rename, shutil.rmtree = killing(pathlib.Path.rename), killing(shutil.rmtree)
with atomic_folder(pathlib.Path(sys.argv[1]), "test", overwrite=True) as folder:
    killing(print)("begun")
    for name, text in json.loads(sys.argv[3]).items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)
"""
"""Writes a folder, and is killed at the k-th of its steps: making the results, each renaming, removing the rest."""


def fill(folder, files):
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)


def write(folder, files, kind="test", *, overwrite=True):
    """One whole run."""
    with atomic_folder(folder, kind, overwrite=overwrite) as results:
        fill(results, files)


def write_killed(folder, k):
    """Return whether a run that writes `NEW` was killed at a step, or had fewer."""
    command = [sys.executable, "-c", KILLED, str(folder), str(k), json.dumps(NEW)]
    code = subprocess.run(command, check=False, stdout=subprocess.DEVNULL).returncode
    assert code in (0, -signal.SIGKILL)
    return code != 0


def contents(folder):
    """Texts of all files, except those of the manifest."""
    paths = [path for path in folder.rglob("*") if path.is_file() and path.name != "manifest.json"]
    return {path.relative_to(folder).as_posix(): path.read_text() for path in paths}


def refused(folder, match, kind="test", **options):
    with pytest.raises(InputError, match=match) as raised, atomic_folder(folder, kind, **options):
        pytest.fail("the folder was opened")
    assert "\n" not in str(raised.value)


class TestFiles:
    def test_file_replaces_the_old_one_at_the_end(self, tmp_path):
        path = tmp_path / ("f" * 255)
        path.write_text("old")
        with atomic_file(path) as part:
            part.write_text("new")
            assert path.read_text() == "old"
        assert contents(tmp_path) == {path.name: "new"}

    @pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
    def test_nothing_is_left_of_a_failure(self, tmp_path, error):
        fill(tmp_path, {"file": "old"})
        with pytest.raises(error), atomic_file(tmp_path / "file") as part:
            part.write_text("new")
            raise error
        with pytest.raises(error), atomic_folder(tmp_path / "a" / "b", "test") as results:
            fill(results, {"one": "1"})
            raise error
        assert contents(tmp_path) == {"file": "old"} and not (tmp_path / "a").exists()

    def test_targets_that_are_no_files_are_refused(self, tmp_path):
        fill(tmp_path, {"precious": "mine"})
        (tmp_path / "link").symlink_to(tmp_path / "precious")
        (tmp_path / "folder").mkdir()
        for target in (tmp_path / "link", tmp_path / "folder", Path(os.devnull)):
            with pytest.raises(InputError, match="not a regular file"), atomic_file(target):
                pytest.fail("the file was opened")
        with pytest.raises(InputError, match=r"Cannot write .*nowhere"), atomic_file(tmp_path / "nowhere" / "file"):
            pytest.fail("the file was opened")
        assert contents(tmp_path) == {"precious": "mine", "link": "mine"}


class TestNewFolders:
    def test_results_appear_at_the_end_with_their_parents(self, tmp_path):
        target = tmp_path / "a" / ("n" * 255)
        with atomic_folder(target, "test") as results:
            fill(results, {"one": "1", "views/0": "four"})
            assert [path.name for path in target.iterdir() if not path.name.startswith(".")] == []
        assert sorted(path.name for path in target.iterdir()) == ["manifest.json", "one", "views"]
        assert json.loads((target / "manifest.json").read_text())["files"] == {"one": 1, "views/0": 4}

    def test_an_empty_folder_is_used_and_a_full_one_refused(self, tmp_path):
        inode = tmp_path.stat().st_ino
        write(tmp_path, NEW, overwrite=False)
        assert (contents(tmp_path), tmp_path.stat().st_ino) == (NEW, inode)
        refused(tmp_path, r"not empty.*--overwrite")

    def test_targets_that_cannot_be_folders(self, tmp_path):
        fill(tmp_path, {"results": "a file"})
        for place in ("results", "results/below"):
            refused(tmp_path / place, "Cannot write to .*; choose another folder", overwrite=True)
        assert contents(tmp_path) == {"results": "a file"}


class TestOverwriting:
    def test_earlier_results_go_and_the_rest_stays(self, tmp_path):
        write(tmp_path, {**OLD, "gone/0": "old"})
        fill(tmp_path, MINE)
        write(tmp_path, NEW)
        assert contents(tmp_path) == {**NEW, **MINE}
        assert not (tmp_path / "gone").exists()

    def test_a_result_that_the_user_changed_is_the_users(self, tmp_path):
        write(tmp_path, OLD)
        fill(tmp_path, {"report.json": "edited", "views/1": "edited"})
        with pytest.raises(InputError, match="has changed since"):
            write(tmp_path, NEW)
        assert contents(tmp_path) == {**OLD, "report.json": "edited", "views/1": "edited"}
        (tmp_path / "report.json").unlink()
        write(tmp_path, NEW)
        assert contents(tmp_path) == {**NEW, "views/1": "edited"}

    @pytest.mark.parametrize("name", ["report.json", "views/0", "manifest.json"])
    def test_files_of_the_user_that_are_in_the_way_stay(self, tmp_path, name):
        fill(tmp_path, {name: "mine"})
        with pytest.raises(InputError, match=rf"{name}' is in the way of a result.*choose another"):
            write(tmp_path, NEW)
        assert (tmp_path / name).read_text() == "mine"
        assert len([path for path in tmp_path.rglob("*") if path.is_file()]) == 1

    def test_what_is_in_the_way_is_found_at_once_where_names_are_known_or_later_stays(self, tmp_path):
        fill(tmp_path, {"views/07.png": "mine"})
        refused(tmp_path, "07.png' is in the way", names=["object.ply", "views/[0-9][0-9].png"], overwrite=True)
        with pytest.raises(InputError, match="in the way"), atomic_folder(tmp_path, "test", overwrite=True) as results:
            fill(results, NEW)
            fill(tmp_path, {"object.ply": "mine"})
        assert contents(tmp_path) == {"views/07.png": "mine", "object.ply": "mine"}

    def test_links_lead_nowhere(self, tmp_path):
        out, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
        write(out, {"views/0": "old"})
        (out / "views").rename(elsewhere)
        (out / "views").symlink_to(elsewhere)
        with pytest.raises(InputError, match="is a symbolic link"):
            write(out, {"views/0": "new"})
        write(out, {"one": "new"})
        (out / "two").symlink_to(elsewhere / "nothing")
        with pytest.raises(InputError, match="in the way"):
            write(out, {"two": "new"})
        assert contents(elsewhere) == {"0": "old"}

    def test_results_of_another_kind_are_not_replaced(self, tmp_path):
        write(tmp_path, OLD, "trim")
        refused(tmp_path, "results of 'trim', which 'views' does not replace", "views", overwrite=True)

    @pytest.mark.parametrize("signed", ["nothing", "another file", "another's secret"])
    def test_a_manifest_that_the_user_did_not_write_names_nothing_to_replace(self, tmp_path, monkeypatch, signed):
        """It names the user's file, with its size, as well as what came with it."""
        out = tmp_path / "out"
        state = os.environ["XDG_STATE_HOME"]
        monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "stranger" if signed == "another's secret" else state))
        write(out, {"one": "old"} if signed == "another file" else {"one": "old", "notes.txt": "mine"})
        monkeypatch.setenv("XDG_STATE_HOME", state)
        fill(out, {"notes.txt": "mine"})
        manifest = json.loads((out / "manifest.json").read_text())
        manifest["files"] = {"one": 3, "notes.txt": 4, "../out/one": 3}
        if signed == "nothing":
            del manifest["signature"]
        (out / "manifest.json").write_text(json.dumps(manifest))
        refused(out, r"manifest.json' is in the way .* written by you .* choose another", overwrite=True)
        assert contents(out) == {"one": "old", "notes.txt": "mine"}

    def test_results_that_were_moved_are_replaced_and_the_secret_is_private(self, tmp_path):
        write(tmp_path / "out", OLD)
        (tmp_path / "out").rename(tmp_path / "moved")
        write(tmp_path / "moved", NEW)
        assert contents(tmp_path / "moved") == NEW
        (secret,) = (state_folder() / "manifests").iterdir()
        assert stat.S_IMODE(secret.stat().st_mode) == 0o600 and len(secret.read_bytes()) == 32

    def test_looking_for_results_keeps_nothing(self, tmp_path, monkeypatch):
        write(tmp_path / "out", OLD)
        monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "elsewhere"))
        assert earlier_results(tmp_path / "out", "test") == []
        assert not (tmp_path / "elsewhere").exists()

    def test_without_a_place_for_a_secret_nothing_is_replaced(self, tmp_path, monkeypatch):
        (tmp_path / "file").touch()
        monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "file"))
        write(tmp_path / "out", OLD)
        refused(tmp_path / "out", "in the way", overwrite=True)
        assert contents(tmp_path / "out") == OLD

    @pytest.mark.parametrize("text", ["", "{}", '{"program": "gaussian-trimmer", "files": []}'])
    def test_a_damaged_manifest_is_a_file_of_the_users(self, tmp_path, text):
        write(tmp_path, {"one": "old"})
        (tmp_path / "manifest.json").write_text(text)
        with pytest.raises(InputError, match="is in the way"):
            write(tmp_path, {"two": "new"})
        assert contents(tmp_path) == {"one": "old"}

    def test_an_input_is_never_replaced(self, tmp_path):
        out = tmp_path / "out"
        write(out, OLD)
        (tmp_path / "link").symlink_to(out / "object.splat")
        for given in (out / "object.splat", tmp_path / "link", out / "views"):
            refused(out, "is an input of this run", inputs=[given], overwrite=True)
        fill(out, {"scene": "mine"})
        with atomic_folder(out, "test", inputs=[out / "scene", tmp_path / "missing"], overwrite=True) as results:
            fill(results, NEW)
        assert contents(out) == {**NEW, "scene": "mine"}


class TestFailedSwaps:
    @pytest.fixture
    def fail_at(self, monkeypatch):
        """Makes the k-th renaming fail, and with `lasting` all that follow; gives the number of renamings so far."""
        rename = os.rename

        def install(k, error, *, lasting=False):
            calls = []

            def failing(*arguments, **options):
                calls.append(arguments)
                if len(calls) == k or (lasting and len(calls) > k):
                    raise error
                return rename(*arguments, **options)

            monkeypatch.setattr(os, "rename", failing)
            return calls

        yield install

    @pytest.mark.parametrize("earlier", [{}, OLD])
    @pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "No space left on device"), KeyboardInterrupt()])
    def test_a_failure_at_any_step_gives_everything_back(self, tmp_path, fail_at, monkeypatch, earlier, error):
        for k in count(1):
            folder = tmp_path / str(k)
            if earlier:
                write(folder, earlier)
                fill(folder, MINE)
            before = contents(tmp_path)
            calls = fail_at(k, error)
            try:
                write(folder, NEW)
            except (InputError, KeyboardInterrupt) as raised:
                assert isinstance(raised, type(error)) or "No space left on device" in str(raised)
            monkeypatch.undo()
            if len(calls) < k:
                break
            assert contents(tmp_path) == before
            assert list(tmp_path.rglob(".*")) == []
            assert earlier or not folder.exists()
        assert k == len(earlier) + bool(earlier) + len(NEW) + 2  # each file and each manifest moved once
        assert contents(folder) == ({**NEW, **MINE} if earlier else NEW)

    def test_what_cannot_be_moved_back_stays_where_it_is_said_to_be(self, tmp_path, fail_at, monkeypatch):
        write(tmp_path, OLD)
        fail_at(4, PermissionError(13, "Permission denied"), lasting=True)
        with pytest.raises(InputError, match=r"\.part/old.*Permission denied"):
            write(tmp_path, NEW)
        assert list(contents(tmp_path).values()).count("old") == len(OLD)
        monkeypatch.undo()
        remove_leftovers(tmp_path)
        assert contents(tmp_path) == OLD

    @pytest.mark.parametrize("earlier", [{}, OLD])
    def test_a_killed_run_is_undone_or_complete(self, tmp_path, earlier):
        """Killed at each step, in a new folder and over earlier results, with a file of the user beside."""
        steps = 1 + len(earlier) + bool(earlier) + len(NEW) + 1 + 1
        for k in count(1):
            folder = tmp_path / str(k)
            if earlier:
                write(folder, earlier)
            fill(folder, MINE)
            if not write_killed(folder, k):
                break
            remove_leftovers(folder)
            assert contents(folder) == {**(NEW if k == steps else earlier), **MINE}
            write(folder, NEW)
            assert contents(folder) == {**NEW, **MINE}
        assert k == steps + 1
        fill(folder, {".gaussian-trimmer.lock": ""})  # all that is left by the very end
        remove_leftovers(folder)
        assert contents(folder) == {**NEW, **MINE}

    @pytest.mark.parametrize("lost", ["journal", "state"])
    def test_what_another_machine_has_begun_stays_and_is_named(self, tmp_path, monkeypatch, caplog, lost):
        """The journal is not here, or there was no place for it."""
        out = tmp_path / "out"
        (tmp_path / "file").touch()
        monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / ("file" if lost == "state" else "there")))
        if lost == "journal":
            write(out, OLD)
        assert write_killed(out, 4 if lost == "journal" else 5)
        monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "here"))
        left = contents(out)
        remove_leftovers(out)
        with pytest.raises(InputError, match="in the way"):
            write(out, OLD)
        assert contents(out) == {name: text for name, text in left.items() if name != ".gaussian-trimmer.lock"}
        (staging,) = out.glob(".gaussian-trimmer.*.part")
        assert f"'{staging}' is of a run that you did not begin" in caplog.text and "delete it" in caplog.text

    def test_a_killed_run_is_not_undone_through_a_link(self, tmp_path):
        out = tmp_path / "out"
        write(out, OLD)
        assert write_killed(out, 7)
        (tmp_path / "elsewhere").mkdir()
        (out / "views").rmdir()
        (out / "views").symlink_to(tmp_path / "elsewhere")
        with pytest.raises(InputError, match="views' is a symbolic link; mend that"):
            write(out, NEW)
        assert contents(tmp_path / "elsewhere") == {}
        (out / "views").unlink()
        remove_leftovers(out)
        assert contents(out) == OLD

    def test_a_file_that_has_taken_the_place_of_an_earlier_result_stays(self, tmp_path):
        write(tmp_path, OLD)
        assert write_killed(tmp_path, 5)
        fill(tmp_path, {"object.splat": "mine"})
        with pytest.raises(InputError, match=r"object\.splat"):
            write(tmp_path, NEW)
        assert (tmp_path / "object.splat").read_text() == "mine"
        (tmp_path / "object.splat").unlink()
        write(tmp_path, NEW)
        assert contents(tmp_path) == NEW


class TestOtherRuns:
    @pytest.mark.parametrize("earlier", [{}, OLD])
    def test_a_second_run_into_a_folder_is_refused_and_the_first_goes_on(self, tmp_path, earlier):
        folder = tmp_path / "a" / "b"
        if earlier:
            write(folder, earlier)
        with atomic_folder(folder, "test", overwrite=True) as results:
            fill(results, NEW)
            refused(folder, r"Another run is writing.*\.gaussian-trimmer\.lock", overwrite=True)
            remove_leftovers(folder)
            write(tmp_path / "other", OLD)
        assert contents(folder) == NEW
        write(folder, OLD)
        assert contents(tmp_path) == {f"{name}/{file}": "old" for name in ("a/b", "other") for file in OLD}

    @pytest.mark.parametrize("kind", ["link", "hard link", "file", "folder", "pipe"])
    def test_what_is_not_a_lock_is_not_opened(self, tmp_path, kind):
        fill(tmp_path, {"precious": "mine", "out/mine": "mine"})
        lock = tmp_path / "out" / ".gaussian-trimmer.lock"
        match kind:
            case "link":
                lock.symlink_to("../precious")
            case "hard link":
                lock.hardlink_to(tmp_path / "precious")
            case "file":
                lock.write_text("precious")
            case "folder":
                lock.mkdir()
            case "pipe":
                os.mkfifo(lock)
        before = contents(tmp_path)
        refused(tmp_path / "out", r"\.gaussian-trimmer\.lock' is not a lock of this program; delete it", overwrite=True)
        remove_leftovers(tmp_path / "out")
        assert contents(tmp_path) == before and os.path.lexists(lock)

    def test_temporary_files_of_a_day_ago_are_removed_and_young_ones_are_not(self, tmp_path):
        fill(tmp_path, {".gaussian-trimmer-0.part": "", ".gaussian-trimmer-1.part": ""})
        os.utime(tmp_path / ".gaussian-trimmer-0.part", (0, 0))
        remove_leftovers(tmp_path)
        assert contents(tmp_path) == {".gaussian-trimmer-1.part": ""}

    def test_the_folder_of_a_killed_run_counts_as_empty(self, tmp_path):
        assert write_killed(tmp_path, 2)
        write(tmp_path, NEW, overwrite=False)
        assert contents(tmp_path) == NEW
