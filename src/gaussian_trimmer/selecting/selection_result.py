"""What is selected, whichever way it was."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.gaussians import BoolArray
from gaussian_trimmer.selecting.marks import Marks
from gaussian_trimmer.selecting.marks_file import write_marks

if TYPE_CHECKING:  # most selections are read from files, and need no kernels
    from gaussian_trimmer.trimming.stroke_cuts import StrokeCut


@dataclass(frozen=True, eq=False)
class SelectionResult:
    """What a file or marks select; `trim` takes it as it is."""

    mask: BoolArray
    """(N,)."""
    marks: Marks | None = None
    """The marks, with everything that their meaning depends on; None if it was not made by marks."""
    interpretations: tuple[str, ...] = ()
    """How each mark was understood."""
    excluded: BoolArray | None = None
    """What a trim does not take in, such as what marks removed and none selected again, (N,); None: nothing."""
    cuts: tuple[StrokeCut, ...] = ()
    """Strokes at which a trim cuts."""

    def __repr__(self) -> str:
        made = f", {', '.join(self.interpretations)}" if self.interpretations else ""
        return f"<SelectionResult: {np.count_nonzero(self.mask):,} of {len(self.mask):,} Gaussians{made}>"

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        """Return the mask, for NumPy."""
        return np.array(self.mask, dtype, copy=bool(copy) or dtype not in (None, np.bool_))

    def save_marks(self, path: str | Path) -> None:
        """Write the marks to a .json file, from which `select` makes the selection again.

        Raises:
            InputError: the file cannot be written.
        """
        assert self.marks is not None, "only what marks select has marks to save"
        write_marks(self.marks, Path(path))
