"""A hole in a picture: stripes, checks and plain walls go on, what is foreign is not copied, and the shadow is told."""

import numpy as np
import pytest

from gaussian_trimmer.removal.relief import patches_with_grain
from gaussian_trimmer.removal.shift_map import inpaint_shift_map

SIZE = 128
ROWS, COLUMNS = np.indices((SIZE, SIZE))
HOLE = (abs(ROWS - 70) < 14) & (abs(COLUMNS - 60) < 14)
KNOWN = ~HOLE
WHITE, BLUE = np.array([0.9, 0.9, 0.85]), np.array([0.2, 0.4, 0.8])


def picture(pattern):
    """White where a pattern (H, W) is one and blue where it is zero, with a little noise."""
    rgb = pattern[..., None] * WHITE + (1 - pattern[..., None]) * BLUE
    return np.clip(rgb + np.random.default_rng(0).normal(0, 0.01, rgb.shape), 0, 1).astype(np.float32)


STRIPES = picture((COLUMNS // 8 % 2).astype(float))
SLANTED = picture(((COLUMNS + ROWS) // 9 % 2).astype(float))
CHECKS = picture(((COLUMNS // 10 + ROWS // 10) % 2).astype(float))
PLAIN = picture(np.ones((SIZE, SIZE)))
GRAVEL = picture(np.repeat(np.repeat(np.random.default_rng(1).random((SIZE // 4,) * 2), 4, 0), 4, 1))


def without_hole(rgb):
    """The picture as it is known: red in the hole."""
    return np.where(HOLE[..., None], [0.8, 0.1, 0.1], rgb).astype(np.float32)


@pytest.mark.parametrize("truth", [STRIPES, SLANTED, CHECKS, PLAIN], ids=["stripes", "slanted", "checks", "plain"])
def test_a_texture_goes_on(truth):
    rgb, factor = inpaint_shift_map(without_hole(truth), KNOWN, HOLE)
    assert np.sqrt(np.mean((rgb - truth)[HOLE] ** 2)) < 0.05
    assert factor.max() < 1.05


def test_something_foreign_nearby_is_not_copied():
    truth = PLAIN.copy()
    truth[60:84, 90:120] = BLUE
    rgb, _ = inpaint_shift_map(without_hole(truth), KNOWN, HOLE)
    assert np.abs(rgb[HOLE] - WHITE).max() < 0.1


def test_a_spot_amid_what_is_unknown_is_not_repeated_in_the_hole():
    truth, known = PLAIN.copy(), ROWS < 56
    spot = (abs(ROWS - 76) < 4) & (abs(COLUMNS - 78) < 4)
    truth[spot] = BLUE
    rgb, _ = inpaint_shift_map(without_hole(truth), known | spot, HOLE)
    assert np.abs(rgb[HOLE] - WHITE).max() < 0.1


@pytest.mark.parametrize("truth", [PLAIN, STRIPES], ids=["plain", "stripes"])
def test_most_of_a_shadow_around_the_hole_is_taken_away(truth):
    distance = np.maximum(abs(ROWS - 70), abs(COLUMNS - 60)) - 14
    shade = 1 - 0.5 * np.exp(-np.maximum(distance, 0) / 6)
    rgb, factor = inpaint_shift_map(without_hole(truth * shade[..., None]), KNOWN, HOLE)
    assert np.sqrt(np.mean((rgb - truth)[HOLE] ** 2)) < 0.08
    dark = KNOWN & (shade < 0.7)
    assert np.median(shade[dark]) < 0.65
    assert 0.8 < np.median(factor[dark] * shade[dark]) < 1.1
    assert np.median(factor[shade > 0.99]) == 1


def test_a_hole_of_which_nothing_is_known_around_is_filled_smoothly():
    known = np.zeros_like(KNOWN)
    known[:2, :2] = True
    rgb, _ = inpaint_shift_map(PLAIN, known, HOLE)
    assert np.isfinite(rgb).all()


def test_what_never_repeats_is_continued_by_whole_pieces():
    rgb, factor = inpaint_shift_map(without_hole(GRAVEL), KNOWN, HOLE)
    patches = patches_with_grain(without_hole(GRAVEL), KNOWN, HOLE, rgb, factor)
    assert (sum(patch.astype(int) for _, patch in patches) == HOLE).all()
    assert patches[0][1].sum() > HOLE.sum() / 2
    for (down, right), patch in patches:
        rows, columns = np.nonzero(patch)
        assert KNOWN[rows + down, columns + right].all()


@pytest.mark.parametrize("truth", [STRIPES, SLANTED, CHECKS, PLAIN], ids=["stripes", "slanted", "checks", "plain"])
def test_what_repeats_or_is_plain_is_not(truth):
    rgb, factor = inpaint_shift_map(without_hole(truth), KNOWN, HOLE)
    assert not patches_with_grain(without_hole(truth), KNOWN, HOLE, rgb, factor)
