"""Folders of results appear whole, or not at all."""

import pytest

from gaussian_trimmer.atomic import atomic_folder
from gaussian_trimmer.errors import InputError


def fill(folder, **contents):
    for name, text in contents.items():
        (folder / name).write_text(text)


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_new_folder_appears_with_its_parents_when_all_is_written(tmp_path):
    target = tmp_path / "a" / "b"
    with atomic_folder(target) as folder:
        fill(folder, one="1")
        assert not target.parent.exists()
    assert names(target) == ["one"]
    assert names(tmp_path) == ["a"]


def test_nothing_is_left_of_a_failure(tmp_path):
    with pytest.raises(KeyboardInterrupt), atomic_folder(tmp_path / "a" / "b") as folder:
        fill(folder, one="1")
        raise KeyboardInterrupt
    assert names(tmp_path) == []


def test_failure_keeps_earlier_results(tmp_path):
    fill(tmp_path, one="old")
    with pytest.raises(RuntimeError), atomic_folder(tmp_path, ["*"], overwrite=True) as folder:
        fill(folder, one="new")
        raise RuntimeError
    assert (tmp_path / "one").read_text() == "old"
    assert names(tmp_path) == ["one"]


def test_empty_folder_is_used_as_it_is(tmp_path):
    inode = tmp_path.stat().st_ino
    with atomic_folder(tmp_path) as folder:
        fill(folder, one="1")
    assert names(tmp_path) == ["one"]
    assert tmp_path.stat().st_ino == inode


def test_overwriting_replaces_results_removes_stale_ones_and_keeps_the_rest(tmp_path):
    fill(tmp_path, one="old", stale_ply="old", notes="mine")
    (tmp_path / "views").mkdir()
    fill(tmp_path / "views", old="old")
    with atomic_folder(tmp_path, ["stale_*"], overwrite=True) as folder:
        fill(folder, one="new")
        (folder / "views").mkdir()
        fill(folder / "views", new="new")
    assert names(tmp_path) == ["notes", "one", "views"]
    assert (tmp_path / "one").read_text() == "new"
    assert names(tmp_path / "views") == ["new"]


def test_folder_that_holds_something_is_refused(tmp_path):
    fill(tmp_path, notes="mine")
    with pytest.raises(InputError, match=r"not empty.*--overwrite"), atomic_folder(tmp_path):
        pytest.fail("the folder was opened")


def test_file_in_the_way_is_refused(tmp_path):
    fill(tmp_path, results="a file")
    with pytest.raises(InputError, match=r"is a file"), atomic_folder(tmp_path / "results", overwrite=True):
        pytest.fail("the file was taken for a folder")
    with pytest.raises(InputError, match=r"choose another folder"), atomic_folder(tmp_path / "results" / "below"):
        pytest.fail("a folder was opened below a file")
