"""Compiled kernels that blend splats. Each reads top to bottom like its equation.

Letters: M drawn Gaussians, T tiles, P pairs of a tile and a Gaussian that reaches it, C blended channels, L labels.

How blending is made to vectorise: everything is float32; the exponential is a polynomial; the loop over a tile's
pixels is flat and has selects instead of branches; a stopped pixel keeps its transmittance with a negative sign, so
that one array holds both. Power is evaluated from the factored inverse covariance, |L^T d|^2, since the plain
quadratic form loses the needles to cancellation in float32.
"""

from __future__ import annotations

import numpy as np

from gaussian_trimmer.parallel import compiled
from gaussian_trimmer.rendering.blending import ALPHA_CAP, ALPHA_CUTOFF, TRANSMITTANCE_STOP
from gaussian_trimmer.rendering.projection_kernels import AREA, TILE_HEIGHT, TILE_WIDTH, _jit

_CHECK_EVERY = 16  # Gaussians between two looks at whether a tile still lets light through.

_CAP = np.float32(ALPHA_CAP)
_CUTOFF = np.float32(ALPHA_CUTOFF)
_STOP = np.float32(TRANSMITTANCE_STOP)
_ONE = np.float32(1)
_ZERO = np.float32(0)

# Minimax polynomial of exp(-q) on [0, 1] with p(0) = 1 (relative error 8e-7); squared three times it covers [0, 8].
# What exp makes smaller than that lies under the alpha cut-off of 1/255 in any case.
_E1, _E2, _E3 = np.float32(0.999970161), np.float32(0.499609905), np.float32(0.164949439)
_E4, _E5 = np.float32(0.0382472937), np.float32(0.00505843309)
_QUARTER = np.float32(0.25)  # Turns the factor of q in exp(-q / 2) into that of q / 16 in exp(-8 (q / 16)).


@compiled(inline="always")
def _falloff(q):  # type: ignore[no-untyped-def]
    """Return exp(-8 q) of q >= 0 by a polynomial of exp(-q), squared three times."""
    q = min(q, _ONE)
    e = _ONE - q * (_E1 - q * (_E2 - q * (_E3 - q * (_E4 - q * _E5))))
    e = e * e
    e = e * e
    return e * e


@compiled(inline="always")
def _within_tile(splat, left, top):  # type: ignore[no-untyped-def]
    """Return A, B, C, u0, v0 and opacity of a splat (8,) in a tile.

    With u = A x + B y + u0 and v = C y + v0 at a pixel of it, the alpha there is opacity times `_falloff` of u^2 + v^2.
    """
    x, y = splat[0] - np.float32(left), splat[1] - np.float32(top)
    A, B, C = _QUARTER * splat[2], _QUARTER * splat[3], _QUARTER * splat[4]
    return A, B, C, -(A * x + B * y), -C * y, splat[5]


@compiled(inline="always")
def _weight_and_light(full, before):  # type: ignore[no-untyped-def]
    """Blend weight of a Gaussian at a pixel, and the light behind it, less than zero where blending has stopped."""
    alpha = min(full, _CAP)
    alpha = alpha if alpha >= _CUTOFF else _ZERO
    weight = alpha * before
    after = before - weight
    goes_on = after >= _STOP
    return (weight if goes_on else _ZERO), (after if goes_on else -abs(before))


@compiled(inline="always")
def _lets_light_through(transmittance):  # type: ignore[no-untyped-def]
    """Tell whether blending goes on at any pixel of a tile."""
    light = _ZERO
    for p in range(AREA):
        light += max(transmittance[p], _ZERO)
    return light > _ZERO


@_jit
def blend_tiles(splats, values, tiles, labels, image, pairs, jobs):  # type: ignore[no-untyped-def]
    """Blend the tiles of some jobs, of which there are as many as tiles, front to back.

    Writes to the pictures (C + 1, T, A) of all tiles the blended values and, last, alpha; and to pairs (P, L), zero
    before, each pair's sum of blend weights under each of the label pictures (L, T, A).
    """
    first_tile, starts, lists, spans, places = tiles
    n_tiles, n_values, n_labels = len(starts) - 1, values.shape[1], labels.shape[0]
    column = np.empty(AREA, np.float32)
    row = np.empty(AREA, np.float32)
    for p in range(AREA):
        column[p] = np.float32(p % TILE_WIDTH) + np.float32(0.5)
        row[p] = np.float32(p // TILE_WIDTH) + np.float32(0.5)
    transmittance = np.empty(AREA, np.float32)
    weights = np.empty(AREA, np.float32)
    sums = np.empty((n_values, AREA), np.float32)
    for job in range(jobs[0], jobs[1]):
        # A stride coprime to the number of tiles spreads the busy middle of the image over the threads' equal shares.
        tile = _interleave(job, n_tiles)
        place = first_tile + tile
        left, top, width, height = places[place, 0], places[place, 1], places[place, 2], places[place, 3]
        for p in range(AREA):  # Pixels outside the image count as stopped.
            outside = left + p % TILE_WIDTH >= width or top + p // TILE_WIDTH >= height
            transmittance[p] = -_ONE if outside else _ONE
        for c in range(n_values):
            for p in range(AREA):
                sums[c, p] = _ZERO
        for pair in range(starts[tile], starts[tile + 1]):
            if (pair - starts[tile]) % _CHECK_EVERY == 0 and not _lets_light_through(transmittance):
                break
            i = lists[pair]
            A, B, C, u0, v0, opacity = _within_tile(splats[i], left, top)
            first, last = TILE_WIDTH * spans[pair, 0], TILE_WIDTH * spans[pair, 1]
            # Slices, since an index that the compiler cannot prove to be non-negative would stop vectorisation.
            columns, rows, light_left, painted = (
                column[first:last],
                row[first:last],
                transmittance[first:last],
                weights[first:last],
            )
            for p in range(len(painted)):
                u = A * columns[p] + (B * rows[p] + u0)
                v = C * rows[p] + v0
                painted[p], light_left[p] = _weight_and_light(opacity * _falloff(u * u + v * v), light_left[p])
            for c in range(n_values):
                total, value = sums[c, first:last], values[i, c]
                for p in range(len(painted)):
                    total[p] += painted[p] * value
            for label in range(n_labels):
                mark, weight = labels[label, place, first:last], _ZERO
                for p in range(len(painted)):
                    weight += painted[p] * mark[p]
                pairs[pair, label] = weight
        for c in range(n_values):
            for p in range(AREA):
                image[c, place, p] = sums[c, p]
        for p in range(AREA):
            image[n_values, place, p] = _ONE - abs(transmittance[p])


@compiled(inline="always")
def _interleave(job, n):  # type: ignore[no-untyped-def]
    stride = 61 if n % 61 else (59 if n % 59 else 1)
    return (job * stride) % n


@_jit
def sum_pairs(pairs, starts, lists, busy, totals):  # type: ignore[no-untyped-def]
    """Adds the pairs' sums (P, K) of busy tiles to the totals (M, K), always in the order of the tiles."""
    for tile in range(len(busy)):
        if not busy[tile]:
            continue
        for pair in range(starts[tile], starts[tile + 1]):
            for k in range(pairs.shape[1]):
                totals[lists[pair], k] += pairs[pair, k]


@_jit
def top_of_pixels(splats, tiles, across, pixels, ids, weights):  # type: ignore[no-untyped-def]
    """Return the largest blend weights of each pixel, in falling order; the nearer Gaussian first among equals.

    Writes as many as there is room for to ids and weights (P, k), which hold -1 and 0, for pixels of a view, so many
    tiles wide, within the tiles.
    """
    first_tile, starts, lists, spans, _ = tiles
    k = ids.shape[1]
    for j in range(pixels.shape[0]):
        x, y = np.float32(pixels[j, 0]) + np.float32(0.5), np.float32(pixels[j, 1]) + np.float32(0.5)
        tile = (pixels[j, 1] // TILE_HEIGHT) * across + pixels[j, 0] // TILE_WIDTH - first_tile
        if not 0 <= tile < len(starts) - 1:
            continue
        transmittance = _ONE
        row = pixels[j, 1] % TILE_HEIGHT
        for pair in range(starts[tile], starts[tile + 1]):
            if not spans[pair, 0] <= row < spans[pair, 1]:
                continue
            i = lists[pair]
            dx, dy = x - splats[i, 0], y - splats[i, 1]
            u, v = _QUARTER * (splats[i, 2] * dx + splats[i, 3] * dy), _QUARTER * splats[i, 4] * dy
            alpha = min(splats[i, 5] * _falloff(u * u + v * v), _CAP)
            if alpha < _CUTOFF:
                continue
            after = transmittance * (_ONE - alpha)
            if after < _STOP:
                break
            weight = alpha * transmittance
            transmittance = after
            slot = k
            while slot > 0 and weights[j, slot - 1] < weight:
                slot -= 1
            for s in range(k - 1, slot, -1):
                ids[j, s], weights[j, s] = ids[j, s - 1], weights[j, s - 1]
            if slot < k:
                ids[j, slot], weights[j, slot] = i, weight
