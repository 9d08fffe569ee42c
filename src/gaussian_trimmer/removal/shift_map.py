"""Inpaint a picture by the shifts under which it repeats, and estimate the shadow around the hole.

After He and Sun, "Statistics of Patch Offsets for Image Completion" (ECCV 2012): what a hole shows is found at a few
offsets that dominate in the picture, since boards continue along themselves, a check from square to square, plaster in
any direction. Here the offsets are those under which the surroundings of the hole agree best with the moved picture
(the sum of squared differences, by Fourier transforms). In place of a graph cut each is weighted by how well it agrees
nearby, and the middle half of what they show is averaged. The same prediction tells where the object darkened the
picture: a shadow lay near the hole where the picture is darker than its repetitions, by more than these differ from it
farther away.
"""

from __future__ import annotations

import cv2
import numpy as np

from gaussian_trimmer.gaussians import BoolArray, FloatArray
from gaussian_trimmer.parallel import parallel_map
from gaussian_trimmer.views.view import bounding_box, box_slices, grown

_MARGIN_PIXELS = 72
"""Examples are taken from this far around the hole."""
_SHIFTS = 40
_SPREAD_PIXELS = 6
"""Shifts differ by more than this along one axis."""
_MIN_SHIFT_PIXELS = 3
RING_PIXELS = 20
"""Width of the ring around the hole in which shifts are compared."""
_MIN_RING_SHARE, _MIN_HOLE_SHARE = 0.3, 0.1
"""Share of the ring, and of the hole, for which the shifted picture must be known."""
_FEWEST_PIXELS = 100
"""Known pixels around a hole that are enough to go by."""
_LEVELS = 16
"""Levels of each colour channel between which colours are told apart."""
_MIN_COLOUR_SHARE = 0.01
"""Share of the ring that must have about the colour of a pixel that is taken."""
_NEARBY_PIXELS = 6.0
"""Standard deviation of the window in which a shift's agreement is measured, and half of that of its correction."""
_SHARPNESS = 1.5
"""Difference, relative to that of the best shift, at which a shift counts 1/e as much."""
_LEAST_DIFFERENCE = 2e-4
"""Squared difference of colours that is noise."""
MAX_ROUNDS = 10
_COARSENING = 4
"""Differences are smoothed on a grid so many times coarser."""
_SHADOW_REACH_PIXELS = 20
"""Width of the ring around the hole in which shadows are looked for."""
_SHADOW_BLUR_PIXELS = 2.0
"""Smoothing of the brightness, at half of the picture's size."""
_SHADOW_DEVIATIONS = 2.0
"""How much darker than predicted a shadow is, in standard deviations of the prediction where no shadow is expected."""
_LEAST_DEVIATION = 0.01
_FAR_SHARE = 0.7
"""Share of the reach beyond which no shadow is expected."""
_MAX_RELIGHT_FACTOR = 4.0
_SHADOWED_FACTOR = 1.04
"""From this relight factor on a pixel is not taken as an example of the surface."""
_DARK = 1e-3


def inpaint_shift_map(rgb: FloatArray, known: BoolArray, hole: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Return a picture (H, W, 3) with its hole filled, without shadow, and relight factors (H, W).

    The factors, at least 1, take the shadow around the hole away from what was seen.

    Args:
        rgb: colours between 0 and 1, (H, W, 3).
        known: pixels whose colours can be relied on, (H, W).
        hole: pixels to be filled, (H, W).
    """
    window = box_slices(bounding_box(hole, _MARGIN_PIXELS))
    filled, factor = rgb.copy(), np.ones(hole.shape, np.float32)
    filled[window], factor[window] = _inpaint(rgb[window], (known & ~hole)[window], hole[window])
    return filled, factor


def _inpaint(rgb: FloatArray, known: BoolArray, hole: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Return the same of the part of the picture around the hole."""
    if known.sum() < _FEWEST_PIXELS:
        return _smoothed_into(rgb, known, hole), np.ones(hole.shape, np.float32)
    factor = _relight_factor(rgb, known, hole)
    lit, examples = without_shadow(rgb, known, hole, factor)
    return _filled(lit, examples, hole, RING_PIXELS), factor


def without_shadow(
    rgb: FloatArray, known: BoolArray, hole: BoolArray, factor: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Return the picture (H, W, 3) without the shadow, and which of its pixels are examples of the surface, (H, W)."""
    lit = np.clip(rgb * factor[..., None], 0, 1).astype(np.float32)
    clear = known & ~hole & ~grown(factor > _SHADOWED_FACTOR, 1)
    enough = (clear & grown(hole, 2 * RING_PIXELS)).sum() >= _FEWEST_PIXELS
    return lit, clear if enough else known & ~hole


def _relight_factor(rgb: FloatArray, known: BoolArray, hole: BoolArray) -> FloatArray:
    """Return how many times brighter the picture would be without the shadow around the hole, (H, W)."""
    height, width = hole.shape
    small = (width // 2, height // 2)

    def halved(image: FloatArray | BoolArray) -> FloatArray:
        return np.asarray(cv2.resize(image.astype(np.float32), small, interpolation=cv2.INTER_AREA))

    seen, inside, colours = halved(known) > 1 - _DARK, halved(hole) > 0, halved(rgb)
    reach = _SHADOW_REACH_PIXELS // 2
    near = grown(inside, reach)
    beyond = seen & ~near
    if beyond.sum() < _FEWEST_PIXELS:
        return np.ones(hole.shape, np.float32)
    predicted = _filled(colours, beyond, near & (seen | inside), RING_PIXELS // 2)
    ring = near & seen & ~inside

    def brightness(image: FloatArray) -> FloatArray:
        return np.asarray(cv2.GaussianBlur(image * ring[..., None], (0, 0), _SHADOW_BLUR_PIXELS) + _DARK)

    # A shadow is dark in all channels; a stripe of another colour is not.
    darker = np.log(brightness(predicted) / brightness(colours)).min(axis=2)
    far = ring & ~grown(inside, round(_FAR_SHARE * reach))
    deviation = _LEAST_DEVIATION
    if far.any():
        usual = float(np.median(darker[far]))
        deviation = max(deviation, 1.4826 * float(np.median(np.abs(darker[far] - usual))))
        darker = darker - usual
    shadow = ring & (darker > _SHADOW_DEVIATIONS * deviation)
    _, parts = cv2.connectedComponents((shadow | inside).astype(np.uint8))
    shadow &= np.isin(parts, np.unique(parts[inside]))
    outside = (~inside).astype(np.float32)
    logarithm, weight = (
        cv2.GaussianBlur(image.astype(np.float32), (0, 0), 1.0) for image in (np.where(shadow, darker, 0), outside)
    )
    factor = np.exp(logarithm / np.maximum(weight, _DARK))
    return np.asarray(
        np.clip(cv2.resize(factor, (width, height), interpolation=cv2.INTER_LINEAR), 1, _MAX_RELIGHT_FACTOR)
    )


def _filled(rgb: FloatArray, examples: BoolArray, hole: BoolArray, ring_width: int) -> FloatArray:
    """Return the picture with its hole filled from examples (H, W), from the rim inwards where no shift spans it."""
    examples = examples & ~hole
    around = examples & grown(hole, 2 * ring_width)
    if not around.any():
        return _smoothed_into(rgb, examples, hole)
    rgb = np.where(examples[..., None], rgb, rgb[around].mean(axis=0)).astype(np.float32)
    examples = _in_large_pieces(examples & of_usual_colour(rgb, around))
    left = hole.copy()
    for _ in range(MAX_ROUNDS):
        ring = examples & grown(left, ring_width)
        done = _fill_by_shifts(rgb, examples, ring, left) if ring.any() else np.zeros_like(hole)
        examples, left = examples | done, left & ~done
        if not left.any():
            return rgb
        if not done.any():
            break
    return _smoothed_into(rgb, examples, left)


def _in_large_pieces(examples: BoolArray) -> BoolArray:
    """Return examples (H, W) without pieces of too few pixels to go by, which shifts would repeat side by side."""
    _, pieces, boxes, _ = cv2.connectedComponentsWithStats(examples.astype(np.uint8))
    large = boxes[:, cv2.CC_STAT_AREA] >= _FEWEST_PIXELS
    large[0] = False  # the rest of the picture
    return np.asarray(large[pieces]) if large.any() else examples


def _fill_by_shifts(rgb: FloatArray, examples: BoolArray, ring: BoolArray, hole: BoolArray) -> BoolArray:
    """Fill those pixels of the hole that a shift reaches, in place; return which, (H, W)."""
    shifts, differences = best_shifts(rgb, examples, ring, hole)
    if not len(shifts):
        return np.zeros_like(hole)
    window = box_slices(bounding_box(ring | hole, round(2 * _NEARBY_PIXELS)))
    here, ring_here = rgb[window], ring[window]
    rows, columns = np.nonzero(hole[window])
    sharpness = _SHARPNESS * (differences[0] + _LEAST_DIFFERENCE)

    def found_at(shift: tuple[int, int], difference: float) -> tuple[FloatArray, FloatArray]:
        down, right = shift
        moved, there = shifted(rgb, down, right, window), shifted(examples, down, right, window)
        both = (there & ring_here).astype(np.float32)
        apart = (here - moved) * both[..., None]
        coarse, squared = _coarsened(np.dstack([apart, both])), _coarsened(np.einsum("hwc,hwc->hw", apart, apart))
        local = _smoothed(np.dstack([squared, coarse[..., 3]]), _NEARBY_PIXELS, both.shape)
        disagreement = (local[..., 0] + 0.01 * difference) / (local[..., 1] + 0.01)
        shades = _smoothed(coarse, 2 * _NEARBY_PIXELS, both.shape)
        corrected = moved + shades[..., :3] / (shades[..., 3:] + 0.02)
        weight = (np.exp(-np.minimum(disagreement / sharpness, 60)) + 1e-12) * there
        return corrected[rows, columns], weight[rows, columns]

    values, weights = zip(*parallel_map(found_at, shifts, differences), strict=True)
    colours, found = _middle_half(np.array(values), np.array(weights))
    here[rows[found], columns[found]] = np.clip(colours[found], 0, 1)
    done = np.zeros_like(hole)
    done[window][rows[found], columns[found]] = True
    return done


def best_shifts(
    rgb: FloatArray, examples: BoolArray, ring: BoolArray, hole: BoolArray
) -> tuple[list[tuple[int, int]], list[float]]:
    """Return the shifts down and right under which ring and examples agree best, and their mean squared differences."""
    height, width = hole.shape
    squared, pairs = _differences(rgb, ring, examples)
    reached = _overlaps(hole, examples)
    down, right = np.indices(squared.shape) - np.array([height, width])[:, None, None]
    far = np.maximum(np.abs(down), np.abs(right)) >= _MIN_SHIFT_PIXELS
    possible = far & (pairs > _MIN_RING_SHARE * ring.sum()) & (reached > _MIN_HOLE_SHARE * hole.sum())
    if not possible.any():
        possible = far & (pairs > 1) & (reached > 0.5)
    mean = np.where(possible, squared / np.maximum(pairs, 1), np.inf)
    free, shifts, found = np.ones(mean.shape, np.bool_), [], []
    candidates = np.flatnonzero(possible)
    for candidate in candidates[np.argsort(mean.ravel()[candidates], kind="stable")]:
        row, column = divmod(int(candidate), mean.shape[1])
        if not free[row, column]:
            continue
        shifts.append((int(down[row, column]), int(right[row, column])))
        found.append(float(mean[row, column]))
        if len(shifts) == _SHIFTS:
            break
        free[
            max(0, row - _SPREAD_PIXELS) : row + _SPREAD_PIXELS + 1,
            max(0, column - _SPREAD_PIXELS) : column + _SPREAD_PIXELS + 1,
        ] = False
    return shifts, found


def _differences(rgb: FloatArray, here: BoolArray, there: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Return the sum of squared differences between pixels and those a shift farther, and their number, for all shifts.

    Only pixels of `here` are compared, with pixels of `there`, both (H, W). Shifts run from -H and -W, (2 H, 2 W).
    """
    colours = rgb - rgb[there].mean(axis=0)  # small numbers, so that single precision suffices
    squared = np.einsum("hwc,hwc->hw", colours, colours)
    images = [np.ones_like(squared), squared, *colours.transpose(2, 0, 1)]
    spectra = list(parallel_map(_spectrum, [part * image for image in images for part in (here, there)]))
    first, second = spectra[:2]
    total = np.conj(spectra[2]) * second + np.conj(first) * spectra[3]
    for ours, theirs in zip(spectra[4::2], spectra[5::2], strict=True):
        total -= 2 * np.conj(ours) * theirs
    return np.maximum(_by_shift(total, here.shape), 0), _by_shift(np.conj(first) * second, here.shape)


def _overlaps(here: BoolArray, there: BoolArray) -> FloatArray:
    """Return how many pixels of `here` meet one of `there` under each shift, (2 H, 2 W)."""
    return _by_shift(np.conj(_spectrum(here)) * _spectrum(there), here.shape)


def _spectrum(image: BoolArray | FloatArray) -> np.ndarray:
    from scipy.fft import rfft2  # in half the time that NumPy's takes

    return np.asarray(rfft2(image.astype(np.float32), _padded(image.shape)))


def _by_shift(spectrum: np.ndarray, shape: tuple[int, ...]) -> FloatArray:
    from scipy.fft import irfft2

    moved = np.roll(irfft2(spectrum, _padded(shape)), shape, axis=(0, 1))
    return np.asarray(moved[: 2 * shape[0], : 2 * shape[1]], np.float32)


def _padded(shape: tuple[int, ...]) -> list[int]:
    """Return twice a picture's size or a little more, so that no shift wraps around and transforms are quick."""
    return [cv2.getOptimalDFTSize(2 * length) for length in shape]


def shifted(image: np.ndarray, down: int, right: int, window: tuple[slice, slice]) -> np.ndarray:
    """Return a window of an image (H, W, ...) that shows what lies a shift farther; zero where nothing does."""
    height, width = image.shape[:2]
    top, left = window[0].start + down, window[1].start + right
    bottom, end = window[0].stop + down, window[1].stop + right
    moved = np.zeros((bottom - top, end - left, *image.shape[2:]), image.dtype)
    part = image[max(0, top) : max(0, min(height, bottom)), max(0, left) : max(0, min(width, end))]
    moved[max(0, -top) :, max(0, -left) :][: part.shape[0], : part.shape[1]] = part
    return moved


def _coarsened(image: FloatArray) -> FloatArray:
    """Return an image (H, W, C) on a coarser grid."""
    height, width = image.shape[:2]
    size = (max(1, width // _COARSENING), max(1, height // _COARSENING))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))


def _smoothed(coarse: FloatArray, deviation: float, shape: tuple[int, ...]) -> FloatArray:
    """Return a Gaussian blur of an image of some shape (H, W) that was coarsened, (H, W, C)."""
    blurred = cv2.GaussianBlur(coarse, (0, 0), deviation / _COARSENING)
    return np.asarray(cv2.resize(blurred, shape[::-1], interpolation=cv2.INTER_LINEAR))


def _middle_half(values: FloatArray, weights: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return the mean of the middle half, by weight (S, P), of S values (S, P, C), and where there is weight, (P,)."""
    total = weights.sum(axis=0)
    order = np.argsort(values, axis=0)
    values = np.take_along_axis(values, order, axis=0)
    sorted_weights = np.take_along_axis(np.broadcast_to(weights[..., None], values.shape), order, axis=0)
    until = np.cumsum(sorted_weights, axis=0)
    low, high = 0.25 * total[:, None], 0.75 * total[:, None]
    part = np.maximum(np.minimum(until, high) - np.maximum(until - sorted_weights, low), 0)
    return (values * part).sum(axis=0) / np.maximum(part.sum(axis=0), 1e-20), total > 0


def of_usual_colour(rgb: FloatArray, around: BoolArray) -> BoolArray:
    """Return the pixels with about the colour of a fair share of those around the hole, (H, W)."""
    level = np.clip((rgb * _LEVELS).astype(np.int64), 0, _LEVELS - 1)
    counts = np.zeros((_LEVELS,) * 3)
    np.add.at(counts, tuple(level[around].T), 1.0)
    for axis in range(3):
        padded = np.pad(counts, [(1, 1) if a == axis else (0, 0) for a in range(3)])
        before, after = (np.take(padded, np.arange(_LEVELS) + step, axis) for step in (0, 2))
        counts = counts + (before + after) / 2
    return np.asarray(counts[tuple(np.moveaxis(level, 2, 0))] > _MIN_COLOUR_SHARE * around.sum())


def _smoothed_into(rgb: FloatArray, known: BoolArray, hole: BoolArray) -> FloatArray:
    """Return the picture with its hole filled smoothly from the known pixels around it (Telea, 2004)."""
    if not known.any():
        return np.where(hole[..., None], 0.5, rgb).astype(np.float32)
    picture = np.round(255 * np.clip(rgb, 0, 1)).astype(np.uint8)
    smooth = cv2.inpaint(picture, (~known).astype(np.uint8), 3, cv2.INPAINT_TELEA).astype(np.float32) / 255
    return np.where(hole[..., None], smooth, rgb).astype(np.float32)
