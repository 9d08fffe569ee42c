"""A disk that is full, or becomes full with the last byte: an error and nothing written, never a file cut short."""

import warnings
from contextlib import contextmanager

import numpy as np
import pytest
import toy
from command_line import save_ball
from format_samples import sample

from gaussian_trimmer import formats
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.io.writing import npy_bytes, write_whole
from gaussian_trimmer.output.pictures import write_picture
from gaussian_trimmer.output.saving import save
from gaussian_trimmer.trimming.trim import trim
from gaussian_trimmer.views.virtual_cameras import PlanConfig

resource = pytest.importorskip("resource", reason="needs limits on the size of files")

GAUSSIANS = sample(150, 1)
PICTURE = np.random.default_rng(0).integers(0, 255, (64, 64, 3)).astype(np.uint8)
WRITERS = {
    **{suffix: (lambda path: formats.write(GAUSSIANS, path)) for suffix in formats.FORMATS},
    ".npy": lambda path: write_whole(path, npy_bytes(np.arange(6000) % 3 == 0)),
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


def contents(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_results_that_do_not_fit_leave_the_earlier_ones(tmp_path):
    scene, truth = save_ball(tmp_path)
    with toy.one_thread():
        trimmed = trim(scene, toy.dilated(scene, truth), config=toy.small_config(plan=PlanConfig(size=96, views=2)))
    folder = tmp_path / "out"
    save(trimmed, folder)
    before = contents(folder)
    for size in sorted({len(data) for data in before.values()}):
        with files_up_to(size - 1), pytest.raises(InputError, match=r"^Cannot write"):
            save(trimmed, folder, overwrite=True)
        assert contents(folder) == before
