"""`trim --remaining DIR`: go on with what an earlier trim left of a scene."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gaussian_trimmer import formats
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.gaussians import BoolArray, Gaussians, IntArray
from gaussian_trimmer.selection_files import trimmed
from gaussian_trimmer.selection_files.selection_file import open_selection


@dataclass(frozen=True, eq=False)
class Remaining:
    """The scene without the objects of an earlier trim."""

    scene: Gaussians
    """What is left, with the outer parts of split Gaussians, (R,)."""
    rows: IntArray
    """Row in the original scene of each, (R,); -1 for what fills a hole, and is in no selection."""
    n_scene: int
    """Number of Gaussians of the original scene, N."""

    @property
    def filled(self) -> BoolArray:
        """Which of the Gaussians the earlier trim made to fill a hole, (R,); they stay in the background."""
        return self.rows < 0

    def of_original(self, selection: BoolArray, what: str) -> BoolArray:
        """What is left of a selection of the original scene (N,), as one of the remaining Gaussians (R,).

        Raises:
            InputError: nothing is left of it.
        """
        left = selection[self.rows] & ~self.filled
        if not left.any():
            raise InputError(f"Nothing is left of {what}: the earlier trim gave all of it to its objects.")
        return left


def read_remaining(folder: Path, original: Gaussians) -> Remaining:
    """What the results in a folder left of the original scene.

    Raises:
        InputError: the folder holds no results of a trim, or those of another scene.
    """
    labels = folder / "labels.npz"
    backgrounds = [folder / f"background{suffix}" for suffix in formats.FORMATS]
    found = [path for path in backgrounds if path.is_file()]
    if not labels.is_file() or len(found) != 1:
        raise InputError(f"'{folder}' holds no results of a trim: labels.npz and one background file are needed.")
    file = open_selection(labels, len(original))
    trimmed.rows_of_objects(file, len(original))  # checks that it belongs to the scene
    rows = np.asarray(file.arrays[trimmed.SOURCE][int(file.arrays[trimmed.OBJECTS].reshape(-1)[0]) :], np.int64)
    scene = formats.read(found[0])
    if len(scene) != len(rows):
        raise InputError(
            f"'{found[0]}' holds {len(scene)} Gaussians, but '{labels}' lists {len(rows)} for it; trim again."
        )
    return Remaining(scene, rows, len(original))
