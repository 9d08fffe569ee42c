"""What a run stands on moves: files are replaced while they are read, clocks jump, and workers run out of memory."""

import builtins
import io
import os
import shutil
import sys
import time
import zipfile
from contextlib import suppress
from itertools import count
from pathlib import Path

import batch_runs
import numba
import numpy as np
import pytest
import test_camera_files
from format_samples import sample
from fuzz.torch_archives import torch_file
from selection_builders import save_ply
from test_streamed_sog import streamed

from gaussian_trimmer import formats
from gaussian_trimmer.camera_files import read_camera_set
from gaussian_trimmer.commands import batch as command
from gaussian_trimmer.commands import parser_of, pools
from gaussian_trimmer.commands.pools import on_processes
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.io.folders import atomic_folder, remove_leftovers
from gaussian_trimmer.io.writing import atomic_file, write_whole
from gaussian_trimmer.selection_files import load_selection

N = 40
SCENE = sample(N, 1)
DAY = 24 * 3600.0


def scene_file(suffix, degree, number):
    return lambda path: formats.write(sample(number, degree), path.with_name(f"a{suffix}"))


def rows(write):
    """A selection of a few rows, and of others."""
    return lambda number: lambda path: write(path, np.arange(N) % 7 < number)


SELECTIONS = {
    "a.npy": rows(lambda path, mask: np.save(path, mask)),
    "a.npz": rows(lambda path, mask: np.savez_compressed(path, mask=mask)),
    "a.txt": rows(lambda path, mask: path.write_text("\n".join(map(str, np.flatnonzero(mask))))),
    "a.pt": rows(lambda path, mask: path.write_bytes(torch_file(mask))),
    "a.ply": rows(lambda path, mask: save_ply(path, SCENE.select(mask).replace(extras={}))),
}
CAMERAS = {
    "images.bin": test_camera_files.write_colmap_binary,
    "images.txt": test_camera_files.write_colmap_text,
    "transforms.json": test_camera_files.write_transforms,
    "cameras.json": test_camera_files.write_inria,
}


def cases():
    """What writes one thing and another to a path, and what reads either, by names of files."""
    for suffix in formats.FORMATS:
        yield f"a{suffix}", scene_file(suffix, 1, N), scene_file(suffix, 3, 9), read_scene
    yield "meta.json", write_unbundled(1.0), write_unbundled(0.5), read_scene
    yield "lod-meta.json", write_streamed, write_another_streamed, read_scene
    for name, write in SELECTIONS.items():
        yield name, write(2), write(4), read_rows
    for name, write in CAMERAS.items():
        few, more = (lambda path, n=n, w=write: w(some_cameras(n), path.parent) for n in (2, 5))
        yield name, few, more, read_cameras


def write_streamed(path):
    streamed(path.parent)


def write_another_streamed(path):
    """The same tree, but all is elsewhere."""
    streamed(path.parent)
    for chunk in path.parent.glob("0_*.sog"):
        found = formats.read(chunk)
        formats.write(found.replace(means=found.means * np.float32(0.5)), chunk)


def write_unbundled(scale):
    def write(path):
        scene = sample(N, 1)
        formats.write(scene.replace(means=scene.means * np.float32(scale)), path.with_name("a.sog"))
        with zipfile.ZipFile(path.with_name("a.sog")) as archive:
            archive.extractall(path.parent)

    return write


def read_scene(path):
    found = formats.read(path)
    return [found.means, found.quaternions, found.sh_rest]


def read_rows(path):
    return [load_selection(path, SCENE)]


def read_cameras(path):
    return [np.array([camera.world_to_camera for camera in read_camera_set(path).cameras])]


def some_cameras(number):
    return test_camera_files.random_cameras()[:number]


class Replacing:
    """Replaces a file when files of its folder are opened for the k-th time."""

    def __init__(self, monkeypatch, folder, k, replace):
        self.opened, self._folder, self._k, self._replace = 0, str(folder), k, replace
        for module in (io, builtins):
            monkeypatch.setattr(module, "open", self._opening(module.open))

    def _opening(self, plain):
        def opening(file, mode="r", *arguments, **options):
            if isinstance(file, str | os.PathLike) and str(file).startswith(self._folder) and "r" in mode:
                self.opened += 1
                if self.opened == self._k:
                    self._replace()
            return plain(file, mode, *arguments, **options)

        return opening


@pytest.mark.parametrize("in_place", [False, True], ids=["renamed", "rewritten"])
@pytest.mark.parametrize("but_the_first", [False, True], ids=["all", "others"])
@pytest.mark.parametrize(
    ("name", "write", "write_other", "read"), [pytest.param(*case, id=case[0]) for case in cases()]
)
def test_what_is_replaced_while_it_is_read_is_one_or_the_other_or_refused(
    name, write, write_other, read, but_the_first, in_place, tmp_path, monkeypatch
):
    expected = []
    for folder, make in (("one", write), ("other", write_other)):
        (tmp_path / folder).mkdir()
        make(tmp_path / folder / name)
        expected.append(read(tmp_path / folder / name))
    coming = [file for file in (tmp_path / "other").iterdir() if not (but_the_first and file.name == name)]

    def replace():
        for file in coming:
            if in_place:
                (place / file.name).write_bytes(file.read_bytes())
            else:
                Path(shutil.copy(file, place / "part")).replace(place / file.name)

    place = shutil.copytree(tmp_path / "one", tmp_path / "after")
    replace()
    with suppress(InputError):  # what is there afterwards, if it can be read
        expected.append(read(place / name))
    for k in count(1):
        place = tmp_path / str(k)
        shutil.copytree(tmp_path / "one", place)
        with monkeypatch.context() as patch:
            watched = Replacing(patch, place, k, replace)
            try:
                found = read(place / name)
            except InputError as error:
                assert str(error).endswith((".", "?")), error
                continue
        whole = [all(map(np.array_equal, found, each)) for each in expected]
        assert any(whole), f"replaced at opening {k}"
        if watched.opened < k:
            break
    assert k > 1


@pytest.mark.parametrize("jump", [-400 * DAY, 400 * DAY])
def test_a_clock_that_jumps_loses_and_half_writes_nothing(jump, tmp_path, monkeypatch):
    """While one run writes, another one begins, for which it is another year."""
    path, out, now = tmp_path / "a.ply", tmp_path / "out", time.time
    path.write_bytes(b"old")
    with atomic_folder(out, "trim") as results:
        (results / "object.ply").write_bytes(b"old")
    with suppress(InputError), atomic_folder(out, "trim", overwrite=True) as results, atomic_file(path) as part:
        part.write_bytes(b"new")
        (results / "object.ply").write_bytes(b"new")
        monkeypatch.setattr(time, "time", lambda: now() + jump)
        write_whole(tmp_path / "b.ply", b"other")
        remove_leftovers(tmp_path)
        with pytest.raises(InputError, match="Another run"), atomic_folder(out, "trim", overwrite=True):
            pass
    assert path.read_bytes() in (b"old", b"new") and (tmp_path / "b.ply").read_bytes() == b"other"
    assert (out / "object.ply").read_bytes() == path.read_bytes()
    for folder in (tmp_path, out):
        assert not [*folder.glob(".gaussian-trimmer*")]


def threads_of_a_worker():
    return str(numba.get_num_threads())


def test_workers_use_no_more_threads_than_the_user_allows(monkeypatch):
    monkeypatch.setenv("NUMBA_NUM_THREADS", "1")
    monkeypatch.setattr(pools, "cores", lambda: 4)
    assert [*on_processes(threads_of_a_worker, [()], 1)] == [(0, "1")]


def trim_within(megabytes, *task):
    """Trim an item of a batch in a process that may take no more than so much memory beyond what it has."""
    import resource  # which Windows does not have

    pages = int(Path("/proc/self/statm").read_text().split()[0])
    limit = pages * resource.getpagesize() + (megabytes << 20)
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    return command.trim_item(*task)


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits on memory are those of Linux")
def test_a_worker_without_memory_makes_an_item_whole_or_not_at_all(tmp_path):
    manifest, ends = batch_runs.write_manifest(tmp_path, batch_runs.save_scenes(tmp_path, 1, 1)), {}
    arguments = parser_of("batch").parse([str(manifest)])
    (item,) = command.items_of(arguments)
    for megabytes in (2, 32, 128, 256, 512, 4096):
        folder = tmp_path / str(megabytes)
        try:
            ((_, said),) = on_processes(trim_within, [(megabytes, item.words, folder, item.files)], 1)
        except InputError as error:  # the system or a library has ended the process
            assert "A worker process died; the machine may have run out of memory." in str(error)
            said = "died"
        if said:
            remove_leftovers(folder)  # as the next run does: nor is there always memory to clear away
        # Some compiled libraries return without memory and do not say why.
        assert said in ("", "died") or "memory" in said or "SystemError" in said, said
        ends[megabytes] = said
        made = sorted(path.name for path in folder.glob("*"))
        assert "object.ply" in made and "manifest.json" in made if not said else made == [], (megabytes, said)
    assert ends[2] and not ends[4096], ends
