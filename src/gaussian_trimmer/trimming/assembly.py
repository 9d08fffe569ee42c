"""Object and background, put together from what was decided, and where each of their rows comes from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gaussian_trimmer.decomposition.refinement import Refined
from gaussian_trimmer.decomposition.splitting import Decomposition
from gaussian_trimmer.gaussians import BoolArray, Gaussians, IntArray, concatenate
from gaussian_trimmer.result import Division, RowLabel


class Assembly(Division):
    """A division in the making, as it passes from stage to stage."""

    def with_fit(self, refined: Refined) -> Assembly:
        """The same with an object whose outline was fitted."""
        n, parent = len(self.object), refined.parent
        label = np.where(refined.part, RowLabel.SPLIT_INSIDE, self.label[parent]).astype(np.uint8)
        return replace(
            self,
            object=refined.object,
            source_index=np.concatenate([self.source_index[parent], self.source_index[n:]]),
            label=np.concatenate([label, self.label[n:]]),
            fitted=np.flatnonzero(refined.fitted),
            not_fitted=refined.skipped_because,
        )

    def with_surfaces(self, relit: Gaussians, relit_rows: IntArray, replaced: IntArray, filled: Gaussians) -> Assembly:
        """The same with what the object stood on as it goes on.

        Args:
            relit: Gaussians without the object's shadow, at the end of the background from now on.
            relit_rows: their scene rows.
            replaced: scene rows of what is in the background no longer.
            filled: new Gaussians at the end of the background.
        """
        n, appended = len(self.object), len(self.outside_parts)
        rows = np.arange(len(self.source_index))
        whole = (rows >= n) & (rows < len(rows) - appended)
        kept = ~(whole & np.isin(self.source_index, np.concatenate([relit_rows, replaced])))
        labels = [np.full(len(relit), RowLabel.RELIT), np.full(len(filled), RowLabel.FILLED)]
        return replace(
            self,
            source_index=np.concatenate([self.source_index[kept], relit_rows, np.full(len(filled), -1, np.int64)]),
            label=np.concatenate([self.label[kept], *labels]).astype(np.uint8),
            dropped=np.union1d(self.dropped, replaced),
            relit=relit,
            filled=filled,
        )


def left_as_it_was(scene: Gaussians, selection: BoolArray, kept: BoolArray) -> Assembly:
    """What is kept (N,) of a selection (N,) that is not trimmed, and the rest of the scene."""
    none = np.zeros(0, np.int64)
    return assemble(scene, selection, np.arange(len(scene)), Decomposition(kept, none), none)


def assemble(
    scene: Gaussians, selection: BoolArray, rows: IntArray, parts: Decomposition, dropped: IntArray
) -> Assembly:
    """Put object and background together.

    Args:
        scene: all N Gaussians.
        selection: which of them were selected, (N,).
        rows: scene rows of the Gaussians that were divided, (L,); all others are the background's.
        parts: how these were divided.
        dropped: scene rows of what neither side gets.
    """
    final, nothing = np.zeros(len(scene), np.bool_), scene.select(slice(0))
    final[rows] = parts.members
    split, inner, outer = rows[parts.split], parts.inner or nothing, parts.outer or nothing
    whole = final.copy()
    whole[split] = False
    final[dropped] = True
    inside, outside = np.flatnonzero(whole), np.flatnonzero(~final)
    labels = [
        np.where(selection[inside], RowLabel.KEPT, RowLabel.RECOVERED),
        np.full(len(split), RowLabel.SPLIT_INSIDE),
        np.where(selection[outside], RowLabel.REMOVED, RowLabel.KEPT),
        np.full(len(outer), RowLabel.SPLIT_OUTSIDE),
    ]
    return Assembly(
        object=concatenate([scene.select(inside), inner]),
        outside_parts=outer,
        source_index=np.concatenate([inside, split, outside, split[: len(outer)]]),
        label=np.concatenate(labels).astype(np.uint8),
        dropped=dropped,
    )
