"""What gsplat makes of Gaussians and a camera before it blends: splats, and lists of those that reach each tile."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

Tensor = Any  # torch is imported late, so its types have no name here.


@dataclass(frozen=True, eq=False)
class Projection:
    """M splats of one view, on the device; the leading 1 of the shapes counts gsplat's cameras."""

    tile: int
    """Side of a tile in pixels."""
    means: Tensor
    """Pixel coordinates, (1, M, 2)."""
    conics: Tensor
    """Inverse covariances xx, xy, yy, (1, M, 3)."""
    opacities: Tensor
    """(1, M)."""
    tile_starts: Tensor
    """Where each tile's list begins in `tile_lists`, (1, tiles down, tiles across)."""
    tile_lists: Tensor
    """Rows of the arrays above, from near to far, tile after tile, (P,)."""

    @property
    def nbytes(self) -> int:
        """Device memory held."""
        held = (self.means, self.conics, self.opacities, self.tile_starts, self.tile_lists)
        return int(sum(tensor.nbytes for tensor in held))

    def apart(self) -> Projection:
        """Return the same picture with a splat of its own for every entry of the tiles' lists."""
        rows = self.tile_lists.long()
        return replace(
            self,
            means=self.means[:, rows],
            conics=self.conics[:, rows],
            opacities=self.opacities[:, rows],
            tile_lists=self.tile_lists.new_ones(len(rows)).cumsum(0, dtype=self.tile_lists.dtype) - 1,
        )
