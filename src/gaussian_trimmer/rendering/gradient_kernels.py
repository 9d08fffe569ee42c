"""Compiled kernels that differentiate a view: the backward passes of `blend_tiles` and `project`.

Letters as in `numba_kernels`. Let a loss have the derivatives g_C (3,) and g_A by a pixel's colour and alpha, and let
v_i = c_i g_C + g_A. With T_i the light that reaches Gaussian i, and w_i = alpha_i T_i its weight,

    dL / d alpha_i = T_i v_i - (sum over all farther j of w_j v_j) / (1 - alpha_i) .

The sum over all Gaussians of w_j v_j is C g_C + A g_A, which the picture itself gives, so that what lies farther is the
difference of that and what was met already: one pass from near to far suffices, as in the forward direction.

With h = alpha dL / d alpha and z = L^T d the pixel's offset from the centre in standard deviations, everything that a
splat's shape needs are the sums over its pixels of h, h z and h z z^T.
"""

from __future__ import annotations

import math

import numpy as np

from gaussian_trimmer.gaussians import SH_C0
from gaussian_trimmer.rendering.blending import LARGEST_SPREAD
from gaussian_trimmer.rendering.numba_kernels import (
    _CAP,
    _CHECK_EVERY,
    _CUTOFF,
    _ONE,
    _ZERO,
    _falloff,
    _interleave,
    _lets_light_through,
    _weight_and_light,
    _within_tile,
)
from gaussian_trimmer.rendering.projection_kernels import AREA, TILE_WIDTH, _jit

N_SUMS = 9
"""Sums of a pair: h; h z (2); h z z^T (xx, xy, yy); weight times g_C (3)."""
N_PARAMETERS = 13
"""Derivatives of a Gaussian by its mean (3), log-scales (3), turn about its own axes (3), opacity logit, sh_dc (3)."""
_FOUR, _SIXTEEN = np.float32(4), np.float32(16)


@_jit
def differentiate_tiles(splats, colours, moves, tiles, images, out, jobs):  # type: ignore[no-untyped-def]
    """Sum over the pixels of each pair of a tile and a Gaussian what `gather` turns into derivatives.

    Args:
        splats, colours: of the M drawn Gaussians, each view's from near to far, (M, 8) and (M, 4).
        moves: which of them are asked for, (M,); the rows of others stay zero.
        tiles: some of the views'.
        images: what the views show, (5, T, A): colour, depth and alpha; and the derivatives of the loss by colour and
            alpha, (4, T, A).
        out: the sums, (P, 9), and in which tiles any of these may differ from zero, (T,); zeros before.
        jobs: first and one past the last of those to do, of which there are as many as tiles.
    """
    first_tile, starts, lists, spans, places = tiles
    image, slopes = images
    pairs, busy = out
    n_tiles = len(starts) - 1
    column = np.empty(AREA, np.float32)
    row = np.empty(AREA, np.float32)
    for p in range(AREA):
        column[p] = np.float32(p % TILE_WIDTH) + np.float32(0.5)
        row[p] = np.float32(p // TILE_WIDTH) + np.float32(0.5)
    transmittance = np.empty(AREA, np.float32)
    slope = np.empty((4, AREA), np.float32)
    farther = np.empty(AREA, np.float32)
    for job in range(jobs[0], jobs[1]):
        tile = _interleave(job, n_tiles)
        end = starts[tile + 1]
        while end > starts[tile] and not moves[lists[end - 1]]:
            end -= 1  # What lies behind the last one that is asked for changes nothing.
        if end == starts[tile]:
            continue
        place = first_tile + tile
        left, top, width, height = places[place, 0], places[place, 1], places[place, 2], places[place, 3]
        steepest = _ZERO
        for p in range(AREA):
            outside = left + p % TILE_WIDTH >= width or top + p // TILE_WIDTH >= height
            transmittance[p] = -_ONE if outside else _ONE
            total = _ZERO
            for c in range(4):
                slope[c, p] = slopes[c, place, p]
                total += slope[c, p] * image[c + c // 3, place, p]
                steepest = max(steepest, abs(slope[c, p]))
            farther[p] = total
        if steepest == _ZERO:
            continue
        busy[tile] = True
        for pair in range(starts[tile], end):
            if (pair - starts[tile]) % _CHECK_EVERY == 0 and not _lets_light_through(transmittance):
                break
            i = lists[pair]
            A, B, C, u0, v0, opacity = _within_tile(splats[i], left, top)
            red, green, blue = colours[i, 0], colours[i, 1], colours[i, 2]
            first, last = TILE_WIDTH * spans[pair, 0], TILE_WIDTH * spans[pair, 1]
            columns, rows, light, behind = (
                column[first:last],
                row[first:last],
                transmittance[first:last],
                farther[first:last],
            )
            slope_r, slope_g, slope_b, slope_a = (
                slope[0, first:last],
                slope[1, first:last],
                slope[2, first:last],
                slope[3, first:last],
            )
            if not moves[i]:
                for p in range(len(light)):
                    u = A * columns[p] + (B * rows[p] + u0)
                    v = C * rows[p] + v0
                    weight, light[p] = _weight_and_light(opacity * _falloff(u * u + v * v), light[p])
                    value = red * slope_r[p] + green * slope_g[p] + blue * slope_b[p] + slope_a[p]
                    behind[p] -= weight * value
                continue
            h, hu, hv, huu, huv, hvv = _ZERO, _ZERO, _ZERO, _ZERO, _ZERO, _ZERO
            wr, wg, wb = _ZERO, _ZERO, _ZERO
            for p in range(len(light)):
                u = A * columns[p] + (B * rows[p] + u0)
                v = C * rows[p] + v0
                full = opacity * _falloff(u * u + v * v)
                weight, light[p] = _weight_and_light(full, light[p])
                value = red * slope_r[p] + green * slope_g[p] + blue * slope_b[p] + slope_a[p]
                rest = behind[p] - weight * value
                behind[p] = rest
                alpha = min(full, _CAP)
                of_p = weight * value - rest * (alpha / (_ONE - alpha))
                # Where the alpha is capped it does not change with the Gaussian.
                of_p = of_p if light[p] > _ZERO and full >= _CUTOFF and full <= _CAP else _ZERO
                h += of_p
                hu += of_p * u
                hv += of_p * v
                huu += of_p * u * u
                huv += of_p * u * v
                hvv += of_p * v * v
                wr += weight * slope_r[p]
                wg += weight * slope_g[p]
                wb += weight * slope_b[p]
            # Offsets are in quarters of standard deviations here.
            pairs[pair, 0], pairs[pair, 1], pairs[pair, 2] = h, _FOUR * hu, _FOUR * hv
            pairs[pair, 3], pairs[pair, 4], pairs[pair, 5] = _SIXTEEN * huu, _SIXTEEN * huv, _SIXTEEN * hvv
            pairs[pair, 6], pairs[pair, 7], pairs[pair, 8] = wr, wg, wb


@_jit
def huber_gradient(image, picture, weight, delta):  # type: ignore[no-untyped-def]
    """Return derivatives of the sum of weight * sqrt(d^2 + delta^2) by what views show, (4, T, A).

    Args:
        image: colour, depth and alpha, (5, T, A).
        picture: the colour and alpha that they should show, (4, T, A); d is the difference.
        weight: of each value, (4, T, A).
        delta: difference beyond which the sum grows in proportion.
    """
    out = np.empty(picture.shape, np.float32)
    square = delta * delta
    for c in range(4):
        for tile in range(picture.shape[1]):
            ours, theirs, weights, slopes = image[c + c // 3, tile], picture[c, tile], weight[c, tile], out[c, tile]
            for p in range(len(theirs)):
                difference = ours[p] - theirs[p]
                slopes[p] = weights[p] * difference / math.sqrt(difference * difference + square)
    return out


@_jit
def gather(ellipsoids, pinhole, splats, colours, sums, out):  # type: ignore[no-untyped-def]
    """Writes the derivatives of the loss by the parameters of M drawn Gaussians, (M, 13).

    How a colour changes because the Gaussian is seen from elsewhere is left out: `means` move by fractions of their
    size. The other arguments are as in `project` and `differentiate_tiles`.
    """
    means, log_scales, quaternions, opacity_logits = ellipsoids
    W, _, lens, limits = pinhole
    fx, fy = lens[0], lens[1]
    e = np.empty((3, 3), np.float64)  # The rotation's columns in the camera's frame: axis, camera coordinate.
    a = np.empty((3, 2), np.float64)  # The same in the image.
    s = np.empty(3, np.float64)
    slope_j = np.empty((2, 3), np.float64)
    in_camera = np.empty(3, np.float64)
    for i in range(means.shape[0]):
        x, y, z = float(means[i, 0]), float(means[i, 1]), float(means[i, 2])
        depth = W[2, 0] * x + W[2, 1] * y + W[2, 2] * z + W[2, 3]
        across = (W[0, 0] * x + W[0, 1] * y + W[0, 2] * z + W[0, 3]) / depth
        down = (W[1, 0] * x + W[1, 1] * y + W[1, 2] * z + W[1, 3]) / depth
        tx, ty = min(max(across, limits[0]), limits[1]), min(max(down, limits[2]), limits[3])
        px, py = fx / depth, fy / depth
        # dL / d centre = L sum(h z), and G = dL / d covariance = L sum(h z z^T) L^T / 2 with L = [[A, 0], [B, C]].
        A, B, C = float(splats[i, 2]), float(splats[i, 3]), float(splats[i, 4])
        along_x, along_y = A * sums[i, 1], B * sums[i, 1] + C * sums[i, 2]
        uu, uv, vv = float(sums[i, 3]), float(sums[i, 4]), float(sums[i, 5])
        g_xx = 0.5 * A * A * uu
        g_xy = 0.5 * A * (B * uu + C * uv)
        g_yy = 0.5 * (B * B * uu + 2 * B * C * uv + C * C * vv)
        qw, qx = float(quaternions[i, 0]), float(quaternions[i, 1])
        qy, qz = float(quaternions[i, 2]), float(quaternions[i, 3])
        norm = math.sqrt(qw * qw + qx * qx + qy * qy + qz * qz)
        qw, qx, qy, qz = qw / norm, qx / norm, qy / norm, qz / norm
        for axis in range(3):
            if axis == 0:
                r0, r1, r2 = 1 - 2 * (qy * qy + qz * qz), 2 * (qx * qy + qw * qz), 2 * (qx * qz - qw * qy)
            elif axis == 1:
                r0, r1, r2 = 2 * (qx * qy - qw * qz), 1 - 2 * (qx * qx + qz * qz), 2 * (qy * qz + qw * qx)
            else:
                r0, r1, r2 = 2 * (qx * qz + qw * qy), 2 * (qy * qz - qw * qx), 1 - 2 * (qx * qx + qy * qy)
            for k in range(3):
                e[axis, k] = W[k, 0] * r0 + W[k, 1] * r1 + W[k, 2] * r2
            a[axis, 0], a[axis, 1] = px * (e[axis, 0] - tx * e[axis, 2]), py * (e[axis, 1] - ty * e[axis, 2])
            s[axis] = math.exp(float(log_scales[i, axis]))
            longest = max(abs(s[axis] * a[axis, 0]), abs(s[axis] * a[axis, 1]))
            if not longest < LARGEST_SPREAD:
                s[axis] = 0.0  # Drawn as if it were shorter, so nothing follows from its length.
        if lens[7] > 0:
            # The opacity has the factor sqrt(det S / det (S + 0.3 I)), S the unfiltered covariance.
            xx, xy, yy = 0.0, 0.0, 0.0
            for axis in range(3):
                xx += s[axis] * s[axis] * a[axis, 0] * a[axis, 0]
                xy += s[axis] * s[axis] * a[axis, 0] * a[axis, 1]
                yy += s[axis] * s[axis] * a[axis, 1] * a[axis, 1]
            det, half = xx * yy - xy * xy, 0.5 * float(sums[i, 0])
            if det > 1e-9 * xx * yy:
                g_xx += half * (yy / det - A * A)
                g_xy += half * (-xy / det - A * B)
                g_yy += half * (xx / det - B * B - C * C)
        # dL / dJ (2, 3) = 2 G J Sigma, Sigma in the camera's frame.
        for k in range(3):
            slope_j[0, k], slope_j[1, k] = 0.0, 0.0
        for axis in range(3):
            ga_x, ga_y = g_xx * a[axis, 0] + g_xy * a[axis, 1], g_xy * a[axis, 0] + g_yy * a[axis, 1]
            for k in range(3):
                slope_j[0, k] += 2 * s[axis] * s[axis] * ga_x * e[axis, k]
                slope_j[1, k] += 2 * s[axis] * s[axis] * ga_y * e[axis, k]
            out[i, 3 + axis] = 2 * s[axis] * s[axis] * (a[axis, 0] * ga_x + a[axis, 1] * ga_y)
            j, k = (axis + 1) % 3, (axis + 2) % 3
            mixed = a[j, 0] * (g_xx * a[k, 0] + g_xy * a[k, 1]) + a[j, 1] * (g_xy * a[k, 0] + g_yy * a[k, 1])
            out[i, 6 + axis] = 2 * (s[j] * s[j] - s[k] * s[k]) * mixed
        # J = [[px, 0, -px tx], [0, py, -py ty]] changes with the place, tx = x / z only inside the limits.
        free_x, free_y = (1.0 if tx == across else 0.0), (1.0 if ty == down else 0.0)
        in_camera[0] = px * along_x - free_x * px / depth * slope_j[0, 2]
        in_camera[1] = py * along_y - free_y * py / depth * slope_j[1, 2]
        in_camera[2] = (
            -px * across * along_x
            - py * down * along_y
            - px / depth * slope_j[0, 0]
            - py / depth * slope_j[1, 1]
            + (1 + free_x) * px * tx / depth * slope_j[0, 2]
            + (1 + free_y) * py * ty / depth * slope_j[1, 2]
        )
        for k in range(3):
            out[i, k] = W[0, k] * in_camera[0] + W[1, k] * in_camera[1] + W[2, k] * in_camera[2]
        out[i, 9] = sums[i, 0] * (1 - 1 / (1 + math.exp(-float(opacity_logits[i]))))
        for c in range(3):
            out[i, 10 + c] = SH_C0 * sums[i, 6 + c] if colours[i, c] > 0 else 0.0
