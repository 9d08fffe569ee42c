"""Compiled kernels that project Gaussians to splats, and list for each tile of the image those that reach it.

No kernel writes beside its arrays, whatever the Gaussians and the camera hold: `project` lets nothing through that is
not finite, and what `_columns_reached` and `_rows_reached` return lies in the image even for splats that are not.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.gaussians import SH_C0, Float64Array, FloatArray, IntArray
from gaussian_trimmer.geometry.limits import LARGEST_LOG_SCALE
from gaussian_trimmer.parallel import compiled
from gaussian_trimmer.rendering.blending import ALPHA_CUTOFF, LARGEST_SPREAD, LARGEST_VALUE, LOW_PASS_VARIANCE

TILE_WIDTH, TILE_HEIGHT = 8, 32
"""Pixels of a tile: as many side by side as a processor computes at once, since most splats are only a few wide, and
each is computed in whole rows."""
AREA = TILE_WIDTH * TILE_HEIGHT
_CANCELLED_SHARE = 1e-8
"""Determinant, as a share of the product of the variances, below which their difference has lost it."""

_jit = compiled(fastmath={"contract", "reassoc", "nsz", "arcp"}, error_model="numpy", nogil=True)


class Ellipsoids(NamedTuple):
    """N Gaussians without their colours, as in `Gaussians`."""

    means: FloatArray
    log_scales: FloatArray
    quaternions: FloatArray
    opacity_logits: FloatArray


class Pinhole(NamedTuple):
    """A camera."""

    world_to_camera: Float64Array
    """(4, 4)."""
    centre: Float64Array
    """(3,)."""
    lens: Float64Array
    """Focal lengths (2), principal point (2), width, height, near plane, whether opacities are compensated, (8,)."""
    limits: Float64Array
    """Slopes x / z (2) and y / z (2) of the widened frustum, (4,)."""


class Tiles(NamedTuple):
    """T tiles that follow each other among those of all views, and the Gaussians that reach them."""

    first: int
    """Number of the first tile."""
    starts: IntArray
    """Where each tile's list begins in `lists`, (T + 1,)."""
    lists: NDArray[np.int32]
    """Indices of drawn Gaussians, from near to far, tile after tile, (P,)."""
    spans: NDArray[np.uint8]
    """First and one past the last row of its tile that each entry of `lists` reaches, (P, 2)."""
    places: IntArray
    """Of the tiles of all views: left and top in their pictures, and these pictures' width and height, (..., 4)."""


@_jit
def project(ellipsoids, sh_dc, sh_rest, pinhole, splats, colours, drawn):  # type: ignore[no-untyped-def]
    """Project N Gaussians by EWA splatting.

    Writes splats (N, 8): pixel centre x, y; A, B, C with |L^T d|^2 = (A dx + B dy)^2 + (C dy)^2; opacity; half extents
    of the alpha cut-off in x and y; colours and depth (N, 4); and which Gaussians reach the image (N,), false before.
    """
    means, log_scales, quaternions, opacity_logits = ellipsoids
    W, centre, lens, limits = pinhole
    fx, fy, cx, cy, width, height, near = lens[0], lens[1], lens[2], lens[3], lens[4], lens[5], lens[6]
    for i in range(means.shape[0]):
        x, y, z = float(means[i, 0]), float(means[i, 1]), float(means[i, 2])
        depth = W[2, 0] * x + W[2, 1] * y + W[2, 2] * z + W[2, 3]
        opacity = 1.0 / (1.0 + math.exp(-float(opacity_logits[i])))
        if not (depth >= near and 0 < depth <= LARGEST_VALUE) or opacity < ALPHA_CUTOFF:
            continue
        across = (W[0, 0] * x + W[0, 1] * y + W[0, 2] * z + W[0, 3]) / depth
        down = (W[1, 0] * x + W[1, 1] * y + W[1, 2] * z + W[1, 3]) / depth
        # J W, with the projection's derivative taken inside the widened frustum.
        tx = min(max(across, limits[0]), limits[1])
        ty = min(max(down, limits[2]), limits[3])
        ux0, ux1, ux2 = (
            fx / depth * (W[0, 0] - tx * W[2, 0]),
            fx / depth * (W[0, 1] - tx * W[2, 1]),
            fx / depth * (W[0, 2] - tx * W[2, 2]),
        )
        uy0, uy1, uy2 = (
            fy / depth * (W[1, 0] - ty * W[2, 0]),
            fy / depth * (W[1, 1] - ty * W[2, 1]),
            fy / depth * (W[1, 2] - ty * W[2, 2]),
        )
        qw, qx = float(quaternions[i, 0]), float(quaternions[i, 1])
        qy, qz = float(quaternions[i, 2]), float(quaternions[i, 3])
        norm = math.sqrt(qw * qw + qx * qx + qy * qy + qz * qz)
        if not 1e-15 < norm < 1e15:  # Squares beyond that leave single precision.
            longest = max(max(abs(qw), abs(qx)), max(abs(qy), abs(qz)))
            qw, qx, qy, qz = qw / longest, qx / longest, qy / longest, qz / longest
            norm = math.sqrt(qw * qw + qx * qx + qy * qy + qz * qz)
        qw, qx, qy, qz = qw / norm, qx / norm, qy / norm, qz / norm
        xx, xy, yy = LOW_PASS_VARIANCE, 0.0, LOW_PASS_VARIANCE
        first_x, first_y, second_x, second_y = 0.0, 0.0, 0.0, 0.0
        area = 0.0  # Sum of the squared areas that any two of the projected semi-axes span.
        for axis in range(3):
            # Column `axis` of the rotation matrix, scaled: one semi-axis of the ellipsoid, projected.
            if axis == 0:
                e0, e1, e2 = 1 - 2 * (qy * qy + qz * qz), 2 * (qx * qy + qw * qz), 2 * (qx * qz - qw * qy)
            elif axis == 1:
                e0, e1, e2 = 2 * (qx * qy - qw * qz), 1 - 2 * (qx * qx + qz * qz), 2 * (qy * qz + qw * qx)
            else:
                e0, e1, e2 = 2 * (qx * qz + qw * qy), 2 * (qy * qz - qw * qx), 1 - 2 * (qx * qx + qy * qy)
            s = math.exp(min(float(log_scales[i, axis]), LARGEST_LOG_SCALE))
            px, py = s * (ux0 * e0 + ux1 * e1 + ux2 * e2), s * (uy0 * e0 + uy1 * e1 + uy2 * e2)
            if not px * px + py * py <= LARGEST_SPREAD * LARGEST_SPREAD:
                length = math.hypot(px, py)
                px, py = LARGEST_SPREAD * (px / length), LARGEST_SPREAD * (py / length)
            xx += px * px
            xy += px * py
            yy += py * py
            area += (first_x * py - first_y * px) ** 2 + (second_x * py - second_y * px) ** 2
            if axis == 0:
                first_x, first_y = px, py
            else:
                second_x, second_y = px, py
        det = xx * yy - xy * xy
        if det < _CANCELLED_SHARE * xx * yy:
            # The same by the formula of Cauchy and Binet, a sum of squares: right for needles, where the two products
            # are equal but for their last digits.
            det = LOW_PASS_VARIANCE * (xx + yy - LOW_PASS_VARIANCE) + area
        if not 0 < det < math.inf:
            continue
        if lens[7] > 0:
            # As much fainter as the low-pass filter has made it larger.
            opacity *= math.sqrt(area / det)
            if opacity < ALPHA_CUTOFF:
                continue
        reach = math.sqrt(max(0.0, 2 * math.log(opacity / ALPHA_CUTOFF)))
        half_x, half_y = reach * math.sqrt(xx), reach * math.sqrt(yy)
        centre_x, centre_y = fx * across + cx, fy * down + cy
        if not (
            centre_x + half_x > 0 and centre_x - half_x < width and centre_y + half_y > 0 and centre_y - half_y < height
        ):
            continue
        drawn[i] = True
        splats[i, 0], splats[i, 1] = centre_x, centre_y
        a = math.sqrt(yy / det)
        splats[i, 2], splats[i, 3], splats[i, 4] = a, -xy / (det * a), 1 / math.sqrt(yy)
        splats[i, 5], splats[i, 6], splats[i, 7] = opacity, half_x, half_y
        dx, dy, dz = x - centre[0], y - centre[1], z - centre[2]
        distance = math.sqrt(dx * dx + dy * dy + dz * dz)
        dx, dy, dz = dx / distance, dy / distance, dz / distance
        for c in range(3):
            colour = max(0.0, 0.5 + _radiance(float(sh_dc[i, c]), sh_rest[i, c], dx, dy, dz))
            colours[i, c] = min(colour, LARGEST_VALUE)
        colours[i, 3] = depth


@compiled(inline="always")
def _radiance(dc, rest, x, y, z):  # type: ignore[no-untyped-def]
    """Return real spherical harmonics of degree 0 to 3 in direction (x, y, z), with the signs of the 3DGS files."""
    k = rest.shape[0]
    value = SH_C0 * dc
    if k >= 3:
        value += 0.4886025119029199 * (-y * rest[0] + z * rest[1] - x * rest[2])
    if k >= 8:
        value += 1.0925484305920792 * (x * y * rest[3] - y * z * rest[4] - x * z * rest[6])
        value += 0.31539156525252005 * (2 * z * z - x * x - y * y) * rest[5]
        value += 0.5462742152960396 * (x * x - y * y) * rest[7]
    if k >= 15:
        value += -0.5900435899266435 * y * (3 * x * x - y * y) * rest[8] + 2.890611442640554 * x * y * z * rest[9]
        value += -0.4570457994644658 * y * (4 * z * z - x * x - y * y) * rest[10]
        value += 0.3731763325901154 * z * (2 * z * z - 3 * x * x - 3 * y * y) * rest[11]
        value += -0.4570457994644658 * x * (4 * z * z - x * x - y * y) * rest[12]
        value += (
            1.445305721320277 * z * (x * x - y * y) * rest[13] - 0.5900435899266435 * x * (x * x - 3 * y * y) * rest[14]
        )
    return value


@compiled(inline="always")
def _columns_reached(splat, start, end):  # type: ignore[no-untyped-def]
    """Return first and one past the last column of tiles, of those from `start` to `end`, that the ellipse touches.

    No column for an ellipse that is not finite. Numbers are compared before they become integers: beyond these lies
    what no processor says the same of.
    """
    low, high = (splat[0] - splat[6]) / TILE_WIDTH, (splat[0] + splat[6]) / TILE_WIDTH
    if not (low < end and high >= start):
        return start, start
    first = math.floor(low) if low > start else start
    last = math.floor(high) + 1 if high < end else end
    return first, last


@compiled(inline="always")
def _rows_reached(splat, left, height):  # type: ignore[no-untyped-def]
    """Return first and one past the last row of pixels that the ellipse reaches within the tiles from column `left` on.

    On the ellipse (A dx + B dy)^2 + (C dy)^2 = q the lowest and highest dy lie at dx = +-(B / A) half_y, or, where that
    is beside the tiles, at the pixel column nearest to it. No row for an ellipse that is not finite.
    """
    A, B, C = float(splat[2]), float(splat[3]), float(splat[4])
    reach = splat[7] * C  # In standard deviations: `project` has taken the logarithm already.
    q = reach * reach + 1e-3  # The margin covers the blending's rounding.
    square = B * B + C * C
    lean = B / A * splat[7]
    x0, x1 = left + 0.5 - splat[0], left + TILE_WIDTH - 0.5 - splat[0]
    x_low, x_high = min(max(lean, x0), x1), min(max(-lean, x0), x1)
    root_low = math.sqrt(max(square * q - (A * C * x_low) ** 2, 0.0))
    root_high = math.sqrt(max(square * q - (A * C * x_high) ** 2, 0.0))
    low = splat[1] - (A * B * x_low + root_low) / square - 0.5
    high = splat[1] + (root_high - A * B * x_high) / square - 0.5
    if math.isnan(low) or math.isnan(high):
        return 0, 0
    first = math.ceil(min(max(low - 1e-3, 0.0), float(height)))
    last = math.floor(min(max(high + 1e-3, -1.0), height - 1.0)) + 1
    return first, last


@_jit
def count_tiles(splats, height, counts, first_column, end_column):  # type: ignore[no-untyped-def]
    """Adds the number of Gaussians that reach each tile of some columns to the zeros of counts (rows + 1, columns).

    The last row is for the kernel's own use. Takes as long for ellipses of many rows as for those of few.
    """
    for i in range(splats.shape[0]):
        x0, x1 = _columns_reached(splats[i], first_column, end_column)
        for tx in range(x0, x1):
            first, last = _rows_reached(splats[i], tx * TILE_WIDTH, height)
            if first < last:  # First those that begin with a tile less those that end above it.
                counts[first // TILE_HEIGHT, tx] += 1
                counts[-(-last // TILE_HEIGHT), tx] -= 1
    for ty in range(1, counts.shape[0]):
        for tx in range(first_column, end_column):
            counts[ty, tx] += counts[ty - 1, tx]


@_jit
def bin_gaussians(splats, offset, picture, tiles, ends, first_column, end_column):  # type: ignore[no-untyped-def]
    """Fills lists and spans of a view's tiles with the Gaussians that reach those of some columns, in their order.

    Args:
        splats: those of the view, (M', 8).
        offset: index of the first of them among those of all views.
        picture: number of the view's first tile among those of all views, its tiles along width and height, and the
            picture's height.
        tiles: some tiles, of which the view has a part.
        ends: where the next entry of each tile goes, at first where its list begins, (T,).
        first_column, end_column: columns of tiles.
    """
    first_tile, starts, lists, spans, _ = tiles
    first_of_view, across, down, height = picture
    n_tiles, skipped = len(starts) - 1, first_tile - first_of_view
    above, below = max(skipped // across, 0), min(-(-(skipped + n_tiles) // across), down)
    for i in range(splats.shape[0]):
        x0, x1 = _columns_reached(splats[i], first_column, end_column)
        for tx in range(x0, x1):
            first, last = _rows_reached(splats[i], tx * TILE_WIDTH, height)
            end = min(-(-last // TILE_HEIGHT), below) if first < last else 0
            for ty in range(max(first // TILE_HEIGHT, above), end):
                tile, top = ty * across + tx - skipped, ty * TILE_HEIGHT
                if not 0 <= tile < n_tiles:
                    continue
                place = ends[tile]
                # Compiled in two places, the arithmetic above may round in two ways: no list grows beyond its end.
                if place < starts[tile + 1]:
                    lists[place] = offset + i
                    spans[place, 0], spans[place, 1] = max(first - top, 0), min(last - top, TILE_HEIGHT)
                    ends[tile] += 1
