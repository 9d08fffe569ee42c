"""What `info` says that a format would lose is what a round trip through it loses."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from format_samples import round_trip, sample

from gaussian_trimmer import formats
from gaussian_trimmer.formats.losses import losses


def test_every_format_is_spoken_of() -> None:
    assert list(losses(sample(10, 0))) == list(formats.FORMATS)


@pytest.mark.parametrize("suffix", [".compressed.ply", ".spz", ".sog"])
def test_centres_move_as_far_as_is_said_and_not_much_less(tmp_path: Path, suffix: str) -> None:
    gaussians = sample(700, 1)
    again = round_trip(gaussians, tmp_path / f"a{suffix}")
    moved = float(np.linalg.norm(again.means.astype(np.float64) - gaussians.means, axis=1).max())
    found = re.search(r"moves centres by up to ([\d.e-]+)", losses(gaussians)[suffix])
    assert found is not None
    assert 0.3 * float(found[1]) < moved <= 1.1 * float(found[1])


@pytest.mark.parametrize(("suffix", "degree"), [(".splat", 0), (".ksplat", 2), (".spz", 3), (".ply", 3), (".glb", 3)])
def test_harmonics_are_kept_to_the_degree_that_is_said(tmp_path: Path, suffix: str, degree: int) -> None:
    gaussians = sample(50, 3)
    assert round_trip(gaussians, tmp_path / f"a{suffix}").sh_degree == degree
    assert ("loses spherical harmonics" in losses(gaussians)[suffix]) == (degree < 3)


def test_what_is_cut_off_is_counted(tmp_path: Path) -> None:
    gaussians = sample(50, 1)
    coefficients = gaussians.sh_rest.copy()
    coefficients[:7, 0, 0] = 2.5
    gaussians = gaussians.replace(sh_rest=coefficients)
    assert "view-dependent colours beyond 1 of 7 Gaussians" in losses(gaussians)[".spz"]
    again = round_trip(gaussians, tmp_path / "a.spz")
    assert np.count_nonzero(np.abs(again.sh_rest - coefficients).max(axis=(1, 2)) > 0.1) == 7


def test_a_scene_too_large_for_spz_cannot_be_written() -> None:
    gaussians = sample(5, 0)
    assert "cannot be written" in losses(gaussians.replace(means=gaussians.means + np.float32(1e7)))[".spz"]


def test_extra_columns_are_left_out_of_all() -> None:
    gaussians = sample(5, 0).replace(extras={"label": np.arange(5)})
    assert all("extra columns" in lost for lost in losses(gaussians).values())
