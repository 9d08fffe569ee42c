"""The .splat file: known bytes, round trips within its precision, damaged files."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from format_samples import error, rotation_error, round_trip, sample

from gaussian_trimmer import formats
from gaussian_trimmer.errors import InputError


def test_known_bytes(tmp_path: Path) -> None:
    path = tmp_path / "a.splat"
    path.write_bytes(struct.pack("<6f8B", 1, 2, 3, 0.5, 1, 2, 255, 0, 128, 255, 128, 255, 128, 128))
    gaussians = formats.read(path)
    np.testing.assert_array_equal(gaussians.means, [[1, 2, 3]])
    np.testing.assert_allclose(gaussians.scales, [[0.5, 1, 2]])
    np.testing.assert_allclose(0.5 + 0.28209479 * gaussians.sh_dc, [[1, 0, 128 / 255]], atol=1e-6)
    np.testing.assert_array_equal(gaussians.quaternions, [[0, 1, 0, 0]])
    assert np.isfinite(gaussians.opacity_logits).all()
    assert gaussians.opacities[0] > 0.9999


def test_round_trip_within_quantisation(tmp_path: Path) -> None:
    gaussians = sample(500, 0)
    again = round_trip(gaussians, tmp_path / "a.splat")
    np.testing.assert_array_equal(again.means, gaussians.means)  # float32
    assert error(again, gaussians, "log_scales") < 1e-6  # float32, by way of exp and log
    assert error(again, gaussians, "opacities") <= 0.5 / 255 + 1e-6  # 8 bits
    assert error(again, gaussians, "sh_dc") <= 0.5 / 255 / 0.28209479 + 1e-6  # 8 bits of colour
    # 8 bits a component in steps of 1/128, and the greatest byte is one step short of 1.
    assert rotation_error(again, gaussians) <= 2 / 128


def test_view_dependent_colour_is_dropped_and_colours_are_clipped(tmp_path: Path) -> None:
    gaussians = sample(10, 2)
    again = round_trip(gaussians.replace(sh_dc=gaussians.sh_dc * 10), tmp_path / "a.splat")
    assert again.sh_degree == 0
    colours = 0.5 + 0.28209479 * again.sh_dc
    np.testing.assert_allclose(colours, np.clip(0.5 + 0.28209479 * 10 * gaussians.sh_dc, 0, 1), atol=0.51 / 255)


def test_four_zero_bytes_of_rotation_mean_none(tmp_path: Path) -> None:
    path = tmp_path / "a.splat"
    path.write_bytes(struct.pack("<6f8B", 0, 0, 0, 1, 1, 1, 9, 9, 9, 9, 128, 128, 128, 128))
    np.testing.assert_array_equal(formats.read(path).quaternions, [[1, 0, 0, 0]])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "zero Gaussians"),
        (bytes(33), "not whole rows"),
        (struct.pack("<6f8B", 0, 0, 0, 1, -1, 1, *[9] * 8), "negative scale in row 0"),
        (struct.pack("<6f8B", 0, np.nan, 0, 1, 1, 1, *[9] * 8), "means that cannot be used"),
        (struct.pack("<6f8B", 0, 0, 0, 1, np.inf, 1, *[9] * 8), "log_scales that cannot be used"),
    ],
)
def test_damaged_files_are_refused(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "a.splat"
    path.write_bytes(content)
    with pytest.raises(InputError, match=message):
        formats.read(path)
