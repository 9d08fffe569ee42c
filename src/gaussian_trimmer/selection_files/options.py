"""What the user may say about a selection file beyond its path."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Literal

from gaussian_trimmer.settings import Range

Kind = Literal[
    "auto", "mask", "labels", "indices", "subset", "property", "classifier", "similarity", "checkpoint", "flashsplat",
    "trimmed",
]  # fmt: skip


@dataclass(frozen=True)
class SelectionOptions:
    """How a selection file is read. The defaults suffice unless the file can be understood in several ways."""

    kind: Kind = "auto"
    """What the file holds; detected from its content by default."""
    object_id: tuple[Annotated[int, Range(-(1 << 31), 1 << 31)], ...] = ()
    """Id of the object, if the file has several; several ids are selected together."""
    property: str | None = None
    """Name of the PLY property, or of the array in an .npz, that holds the selection."""
    threshold: Annotated[float, Range(-1e30, 1e30)] | None = None
    """Values above it are selected. Default: 0 for a property, 0.3 for a classifier's probability, 0.9 for a similarity
    and for a checkpoint's probability; scores in an array have no default."""
    classifier: Path | None = None
    """Classifier of the identity features that the PLY or the checkpoint holds."""
    query_row: Annotated[int, Range(0, 1 << 32)] | None = None
    """Row number, from 0, of a Gaussian on the object; Gaussians with similar identity features are selected."""
    query_point: tuple[Annotated[int, Range(0, 1 << 20)], Annotated[int, Range(0, 1 << 20)]] | None = None
    """The same by a pixel X Y on the object, in the view that --view or --view-index names."""
    gamma: Annotated[float, Range(-1, 1)] = 0.0
    """FlashSplat's background bias: positive values select less, negative ones more; -1 to 1 is useful."""

    def given(self) -> frozenset[str]:
        """Return names of the options other than `kind` that differ from their defaults."""
        changed = (field.name for field in fields(self) if getattr(self, field.name) != field.default)
        return frozenset(changed) - {"kind"}


def flag(option: str) -> str:
    """Return how an option is spelt on the command line.

    >>> flag("object_id")
    '--selection.object-id'
    """
    return "--selection." + option.replace("_", "-")
