"""A disk that is full, or becomes full with the last byte: an error and nothing written, never a file cut short."""

import os
import subprocess
import warnings
from contextlib import contextmanager

import numpy as np
import pytest
import toy
from command_line import SMALL, run, save_ball
from format_samples import sample

from gaussian_trimmer import formats
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.output.pictures import write_picture
from gaussian_trimmer.planning.virtual_cameras import PlanConfig
from gaussian_trimmer.selecting.saved_selection import save_array
from gaussian_trimmer.trimming.trim import trim

resource = pytest.importorskip("resource", reason="needs limits on the size of files")

GAUSSIANS = sample(150, 1)
PICTURE = np.random.default_rng(0).integers(0, 255, (64, 64, 3)).astype(np.uint8)
WRITERS = {
    **{suffix: (lambda path: formats.write(GAUSSIANS, path)) for suffix in formats.FORMATS},
    ".npy": lambda path: save_array(np.arange(6000) % 3 == 0, path),
    ".png": lambda path: write_picture(PICTURE, path),
}


@contextmanager
def files_up_to(size):
    """No file grows beyond a size; what would lie beyond fails as on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.fixture(scope="module")
def small_disk(tmp_path_factory):
    """A disk of 256 kB of its own."""
    place = tmp_path_factory.mktemp("disk")
    mount = ["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", str(place)]
    if not hasattr(os, "geteuid") or os.geteuid() != 0 or subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("only root can mount a small disk, and not everywhere")
    yield place
    subprocess.run(["umount", str(place)], check=True)


def leave(disk, size):
    """Fill a disk so that this many bytes are left."""
    for path in disk.iterdir():
        path.unlink()
    free = os.statvfs(disk)
    (disk / "fill").write_bytes(bytes(free.f_bavail * free.f_bsize - size))


@pytest.mark.parametrize("suffix", WRITERS)
def test_file_that_does_not_fit_to_the_last_byte_is_not_written(tmp_path, suffix):
    path = tmp_path / f"out{suffix}"
    WRITERS[suffix](path)
    data = path.read_bytes()
    path.write_text("old")
    for missing in (1, 100, len(data) - 1):
        with (
            files_up_to(len(data) - missing),
            warnings.catch_warnings(),
            pytest.raises(InputError, match=r"^Cannot write .*"),
        ):
            warnings.simplefilter("error")
            WRITERS[suffix](path)
        assert path.read_text() == "old"
        assert list(tmp_path.iterdir()) == [path]
    with files_up_to(len(data)):
        WRITERS[suffix](path)
    assert path.read_bytes() == data


@pytest.mark.parametrize("suffix", WRITERS)
def test_full_disk_ends_in_an_error(small_disk, tmp_path, suffix):
    WRITERS[suffix](tmp_path / f"out{suffix}")
    size = (tmp_path / f"out{suffix}").stat().st_size
    path = small_disk / f"out{suffix}"
    for pages in range(size // 4096 + 1):
        leave(small_disk, 4096 * pages)
        with pytest.raises(InputError, match="No space left on device"):
            WRITERS[suffix](path)
        assert [left.name for left in small_disk.iterdir()] == ["fill"]


@pytest.fixture(scope="module")
def ball(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ball")
    return folder, *save_ball(folder)


@pytest.fixture(scope="module")
def trimmed(ball):
    _, scene, truth = ball
    with toy.one_thread():
        return trim(scene, toy.dilated(scene, truth), config=toy.small_config(plan=PlanConfig(size=96, views=2)))


def contents(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_results_that_do_not_fit_leave_the_earlier_ones(trimmed, tmp_path):
    trimmed.save(tmp_path)
    before = contents(tmp_path)
    sizes = sorted({len(data) for data in before.values()})
    assert len(sizes) > 6
    for size in sizes:
        with files_up_to(size - 1), pytest.raises(InputError, match=r"^Cannot write"):
            trimmed.save(tmp_path, overwrite=True)
        assert contents(tmp_path) == before
    with files_up_to(sizes[-1]):
        trimmed.save(tmp_path, overwrite=True)
    assert contents(tmp_path) == before


def test_commands_on_a_full_disk(ball, small_disk, capsys):
    folder, _, _ = ball
    leave(small_disk, 4096)
    scene, rough, cameras = (folder / name for name in ("scene.ply", "rough.npy", "cameras.json"))
    for command in (
        ["trim", scene, rough, "--output", small_disk / "out", *SMALL, "--views", 2],
        ["select", scene, "--cameras", cameras, "--list-views", small_disk / "views"],
        ["convert", scene, small_disk / "scene.ply"],
    ):
        assert run(*command) == 2
        said = capsys.readouterr().err
        assert "No space left on device" in said
        assert said.count("\n") == 1
        assert [left.name for left in small_disk.iterdir()] == ["fill"]
