"""Gaussians as some cameras see them: projected, sorted by depth, and listed for every tile of every picture.

The tiles of all views follow each other, and so do the Gaussians that are drawn in them: one loop blends them all.
Pictures are kept tile by tile, (C, T, A) with the A pixels of a tile row by row, until somebody asks for an image.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from gaussian_trimmer.cameras import Camera
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians, IntArray
from gaussian_trimmer.parallel import WORTH_A_THREAD, for_each, parallel_for
from gaussian_trimmer.rendering.blending import FRUSTUM_MARGIN, MOST_PAIRS
from gaussian_trimmer.rendering.projection_kernels import (
    AREA,
    TILE_HEIGHT,
    TILE_WIDTH,
    Ellipsoids,
    Pinhole,
    Tiles,
    bin_gaussians,
    count_tiles,
    project,
)

_LISTED_BYTES = 1 << 29
"""Memory for the lists of all tiles, and for the weights of their entries."""
_BYTES_OF_A_PAIR = 6
_BYTES_OF_A_WEIGHT = 4
_PROJECTED_TOGETHER = 1 << 16
"""Gaussians that are projected in one call, so that what is copied of a table stays small."""
_SIDE_BY_SIDE = 1 << 18
"""Fewer Gaussians than this are projected for several views at a time, one a thread; more for one after the other."""


@dataclass(frozen=True, eq=False)
class Projection:
    """The Gaussians that can reach a pixel of V views, M in all, each view's from near to far, and the T tiles."""

    n: int
    """Number of Gaussians that were projected, drawn or not."""
    cameras: Sequence[Camera]
    rows: IntArray
    """Row of each drawn Gaussian in the scene, (M,)."""
    splats: FloatArray
    """Pixel centre (2), factor of the inverse covariance (3), opacity, half extents (2), (M, 8)."""
    colours: FloatArray
    """RGB and depth, (M, 4)."""
    view_starts: IntArray
    """Where the Gaussians of each view begin, (V + 1,)."""
    first_tiles: IntArray
    """Number of the first tile of each view, (V + 1,)."""
    tile_starts: IntArray
    """Where each tile's list begins among the lists of all tiles, (T + 1,)."""
    tiles: Tiles | None
    """The lists of all tiles, or None where they are so long that they are made part by part."""

    @property
    def nbytes(self) -> int:
        """Memory held."""
        lists = self.tiles.lists.nbytes + self.tiles.spans.nbytes if self.tiles else 0
        return self.rows.nbytes + self.splats.nbytes + self.colours.nbytes + self.tile_starts.nbytes + lists

    @cached_property
    def places(self) -> IntArray:
        """Left and top of each tile in its picture, and that picture's width and height, (T, 4)."""
        of_views = [_places(camera.width, camera.height) for camera in self.cameras]
        return np.concatenate([np.zeros((0, 4), np.int64), *of_views])

    def drawn(self, view: int) -> slice:
        """Return the Gaussians of a view, among the M."""
        return slice(self.view_starts[view], self.view_starts[view + 1])

    def parts(self, n_labels: int = 0) -> Iterator[Tiles]:
        """Yield all tiles in order, in as few runs as keep lists, and n_labels weights of each entry, within memory."""
        of_an_entry = max(_BYTES_OF_A_PAIR, _BYTES_OF_A_WEIGHT * n_labels)
        first, n_tiles, starts = 0, len(self.tile_starts) - 1, self.tile_starts
        while first < n_tiles:
            room = starts[first] + _LISTED_BYTES // of_an_entry
            last = min(max(int(np.searchsorted(starts, room, side="right")) - 1, first + 1), n_tiles)
            yield self._part(first, last)
            first = last

    def _part(self, first: int, last: int) -> Tiles:
        """Return the tiles from `first` up to before `last`."""
        begin, end = self.tile_starts[[first, last]]
        starts = self.tile_starts[first : last + 1] - begin
        if self.tiles is not None:
            return Tiles(first, starts, self.tiles.lists[begin:end], self.tiles.spans[begin:end], self.places)
        return _binned(self, starts, first)

    def by_view(self, tiles: Tiles) -> list[tuple[int, int]]:
        """Return where the tiles of each view begin and end among those of a part."""
        ends = np.clip(self.first_tiles - tiles.first, 0, len(tiles.starts) - 1)
        return list(zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True))

    def of(self, part: BoolArray) -> Projection:
        """Return what the views show where only a part of the Gaussians (N,) is in them."""
        kept = part[self.rows]
        numbers, starts = np.append(0, np.cumsum(kept)), np.append(0, self._reaching(kept).cumsum())
        rows, splats, colours = self.rows[kept], self.splats[kept], self.colours[kept]
        shown = Projection(
            self.n, self.cameras, rows, splats, colours, numbers[self.view_starts], self.first_tiles, starts, None
        )
        if self.tiles is None:
            return shown.with_lists()
        tiles = self._entries(kept[self.tiles.lists], starts)
        return replace(shown, tiles=tiles._replace(lists=numbers[tiles.lists].astype(np.int32)))

    def around(self, part: BoolArray) -> Projection:
        """Return the same views, where only tiles that a part of the Gaussians (N,) reaches list any."""
        wanted, counts = self._reaching(part[self.rows]) > 0, np.diff(self.tile_starts)
        starts = np.append(0, np.where(wanted, counts, 0).cumsum())
        tiles = None if self.tiles is None else self._entries(np.repeat(wanted, counts), starts)
        return replace(self, tile_starts=starts, tiles=tiles)

    def with_lists(self) -> Projection:
        """Return the same with the lists of all tiles, where they are not too long."""
        listed = self.tile_starts[-1] * _BYTES_OF_A_PAIR <= _LISTED_BYTES
        return replace(self, tiles=_binned(self, self.tile_starts, 0)) if listed else self

    def _reaching(self, kept: BoolArray) -> IntArray:
        """Return how many of some drawn Gaussians, (M,), reach each tile, (T,)."""
        if self.tiles is not None:
            return np.diff(np.append(0, np.cumsum(kept[self.tiles.lists]))[self.tile_starts])
        views = ((camera, self.drawn(view)) for view, camera in enumerate(self.cameras))
        counts = [_counted(self.splats[drawn][kept[drawn]], camera) for camera, drawn in views]
        return np.concatenate([np.zeros(0, np.int64), *counts])

    def _entries(self, chosen: BoolArray, starts: IntArray) -> Tiles:
        """Return the tiles with the chosen ones of their entries, (P,), which begin at `starts`."""
        assert self.tiles is not None
        return Tiles(0, starts, self.tiles.lists[chosen], self.tiles.spans[chosen], self.places)

    def scattered(self, sums: FloatArray) -> FloatArray:
        """Return sums of drawn Gaussians (M, L) as sums of all N Gaussians in each view, (V, N, L)."""
        all_sums = np.zeros((len(self.cameras), self.n, sums.shape[1]), np.float32)
        for view in range(len(self.cameras)):
            all_sums[view, self.rows[self.drawn(view)]] = sums[self.drawn(view)]
        return all_sums

    def images(self, tiled: FloatArray) -> list[FloatArray]:
        """Return pictures (C, T, A) as an image of each view, (C, H, W)."""
        found = []
        for camera, first, last in zip(self.cameras, self.first_tiles[:-1], self.first_tiles[1:], strict=True):
            across, down = tiles_of(camera)
            part = tiled[:, first:last].reshape(len(tiled), down, across, TILE_HEIGHT, TILE_WIDTH).swapaxes(2, 3)
            whole = part.reshape(len(tiled), down * TILE_HEIGHT, across * TILE_WIDTH)
            found.append(whole[:, : camera.height, : camera.width])
        return found

    def tiled(self, images: Sequence[FloatArray]) -> FloatArray:
        """Return an image of each view, (C, H, W), as pictures (C, T, A), zero beside them."""
        found = [as_tiles(image) for image in images]
        return np.concatenate(found, axis=1) if found else np.zeros((0, 0, AREA), np.float32)


def as_tiles(image: FloatArray) -> FloatArray:
    """Return an image (C, H, W) as a picture (C, T, A), zero beside it."""
    missing = -image.shape[1] % TILE_HEIGHT, -image.shape[2] % TILE_WIDTH
    whole = np.pad(image, ((0, 0), (0, missing[0]), (0, missing[1]))) if any(missing) else image
    down, across = whole.shape[1] // TILE_HEIGHT, whole.shape[2] // TILE_WIDTH
    parts = whole.reshape(len(image), down, TILE_HEIGHT, across, TILE_WIDTH).swapaxes(2, 3)
    return np.ascontiguousarray(parts.reshape(len(image), -1, AREA), np.float32)


def project_views(
    gaussians: Gaussians, cameras: Sequence[Camera], around: BoolArray | None = None, *, colours: bool = True
) -> Projection:
    """Project, sort by depth (ties by row) and bin into tiles.

    Args:
        gaussians: N Gaussians.
        cameras: the views.
        around: Gaussians to whose tiles the others are binned only, (N,); None: to all tiles.
        colours: whether colours are right; without, which saves a third of the time, they are those without harmonics.

    Raises:
        InputError: the pairs of a tile and a Gaussian that reaches it are more than `MOST_PAIRS`.
    """
    if not colours:
        gaussians = gaussians.replace(sh_rest=gaussians.sh_rest[..., :0])
    if len(gaussians) < _SIDE_BY_SIDE and len(cameras) > 1:
        found = for_each(lambda camera: _project_view(gaussians, camera, around), cameras)
    else:
        found = [_project_view(gaussians, camera, around) for camera in cameras]
    none = np.zeros(0, np.int64), np.zeros((0, 8), np.float32), np.zeros((0, 4), np.float32)
    columns = zip(none, *(view[:3] for view in found), strict=True)
    rows, splats, shown = found[0][:3] if len(found) == 1 else map(np.concatenate, columns)
    view_starts = np.append(0, np.cumsum([len(view[0]) for view in found], dtype=np.int64))
    counts = [view[3] for view in found]
    first_tiles = np.append(0, np.cumsum([len(of_view) for of_view in counts], dtype=np.int64))
    starts = np.concatenate([np.zeros(1, np.int64), *counts]).cumsum()
    n = len(gaussians)
    return Projection(n, cameras, rows, splats, shown, view_starts, first_tiles, starts, None).with_lists()


def _project_view(
    gaussians: Gaussians, camera: Camera, around: BoolArray | None
) -> tuple[IntArray, FloatArray, FloatArray, IntArray]:
    """Return rows, splats and colours of what a view shows, from near to far, and how many reach each tile, (T,)."""
    splats, colours, drawn = _projected(gaussians, camera)
    # A key of depth bits above the row number sorts by depth, ties by row, with one plain sort.
    candidates = np.flatnonzero(drawn)
    keys = colours[candidates, 3].view(np.uint32).astype(np.uint64) << np.uint64(32) | candidates.astype(np.uint64)
    keys.sort()
    rows = (keys & np.uint64(0xFFFFFFFF)).astype(np.int64)
    splats, colours = splats.take(rows, axis=0), colours.take(rows, axis=0)
    counts = _counted(splats, camera)
    if around is not None:
        counts[_counted(splats[around[rows]], camera) == 0] = 0
    if counts.sum() > MOST_PAIRS:
        raise InputError(
            f"A view of {camera.width} x {camera.height} pixels consists of {counts.sum():,} pairs of a tile and a "
            f"Gaussian that reaches it, and at most {MOST_PAIRS:,} can be drawn; take smaller views, or remove "
            "Gaussians that are as large as the whole picture."
        )
    return rows, splats, colours, counts


def _projected(gaussians: Gaussians, camera: Camera) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return what `project` finds of all Gaussians; columns of a table become arrays of their own share by share."""
    n = len(gaussians)
    found = np.empty((n, 8), np.float32), np.empty((n, 4), np.float32), np.zeros(n, np.bool_)
    pinhole = pinhole_of(camera, gaussians.antialiased)

    def part(first: int, last: int) -> None:
        share = slice(first, last)
        sh_dc, sh_rest = _owned(gaussians.sh_dc[share]), _owned(gaussians.sh_rest[share])
        project(ellipsoids_of(gaussians, share), sh_dc, sh_rest, pinhole, *(array[share] for array in found))

    parallel_for(part, n, _PROJECTED_TOGETHER, at_least=WORTH_A_THREAD)
    return found


def _counted(splats: FloatArray, camera: Camera) -> IntArray:
    """Return how many splats reach each tile of a view, (T,)."""
    across, down = tiles_of(camera)
    table = np.zeros((down + 1, across), np.int64)
    _by_columns(lambda first, last: count_tiles(splats, camera.height, table, first, last), across, len(splats))
    return table[:-1].ravel()


def _binned(projection: Projection, starts: IntArray, first: int) -> Tiles:
    """Return the tiles from `first` on whose lists begin at `starts` (T' + 1,), with their lists."""
    lists, spans = np.zeros(starts[-1], np.int32), np.zeros((starts[-1], 2), np.uint8)
    tiles, ends = Tiles(first, starts, lists, spans, projection.places), starts[:-1].copy()

    def work(view: int) -> None:
        camera, drawn = projection.cameras[view], projection.drawn(view)
        splats, begin = projection.splats[drawn], int(projection.first_tiles[view])
        across, down = tiles_of(camera)
        if begin < first + len(ends) and begin + across * down > first:
            picture = begin, across, down, camera.height
            _by_columns(
                lambda left, right: bin_gaussians(splats, drawn.start, picture, tiles, ends, left, right),
                across,
                len(splats),
            )

    for_each(work, range(len(projection.cameras)))
    return tiles


def _by_columns(work: Callable[[int, int], Any], across: int, n_splats: int) -> None:
    """Call work(first, last) for columns of tiles, side by side if there are many Gaussians to go through for each."""
    parallel_for(work, across, at_least=1 if n_splats >= WORTH_A_THREAD else across)


def tiles_of(camera: Camera) -> tuple[int, int]:
    """Return how many tiles a picture has along its width and its height."""
    return -(-camera.width // TILE_WIDTH), -(-camera.height // TILE_HEIGHT)


@lru_cache(maxsize=16)
def _places(width: int, height: int) -> IntArray:
    """Return left and top of each tile of a picture, and its width and height, (T, 4)."""
    down, across = np.indices((-(-height // TILE_HEIGHT), -(-width // TILE_WIDTH)))
    top, left = TILE_HEIGHT * down.ravel(), TILE_WIDTH * across.ravel()
    return np.column_stack([left, top, np.full(len(left), width), np.full(len(left), height)])


def _owned(values: FloatArray) -> FloatArray:
    """Return the same array, or a copy if it is a column of a table or cannot be written: kernels are compiled once."""
    return np.require(values, requirements=("C", "W"))


def ellipsoids_of(gaussians: Gaussians, rows: IntArray | slice) -> Ellipsoids:
    """Return gaussians, or some of them, as the kernels take them."""
    g = gaussians
    return Ellipsoids(*(_owned(a[rows]) for a in (g.means, g.log_scales, g.quaternions, g.opacity_logits)))


def pinhole_of(camera: Camera, antialiased: bool) -> Pinhole:
    """Return a camera as the kernels take it, for Gaussians that are antialiased or not."""
    margin = FRUSTUM_MARGIN * np.array([camera.width, camera.height])
    fx, fy, cx, cy = camera.K[0, 0], camera.K[1, 1], camera.K[0, 2], camera.K[1, 2]
    with np.errstate(all="ignore"):  # Lenses that are possible in name only show nothing; the kernel sees to that.
        limits = np.array(
            [
                (-margin[0] - cx) / fx,
                (camera.width + margin[0] - cx) / fx,
                (-margin[1] - cy) / fy,
                (camera.height + margin[1] - cy) / fy,
            ]
        )
    lens = np.array([fx, fy, cx, cy, camera.width, camera.height, camera.near, antialiased], np.float64)
    return Pinhole(np.ascontiguousarray(camera.world_to_camera), camera.centre, lens, limits)
