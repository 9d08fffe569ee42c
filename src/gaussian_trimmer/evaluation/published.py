"""Published figures of methods, each with the protocol by which it was measured, if that is known."""

from __future__ import annotations

from dataclasses import dataclass

Pair = tuple[float, float | None]
"""A figure in percent before and after GaussianTrimmer; None where it is not known."""


@dataclass(frozen=True)
class Published:
    """A row of a published table."""

    method: str
    iou: Pair
    second: Pair | None
    """The data set's second metric."""
    protocol: str | None = None
    """The protocol of the figures, as the method's own code has it; None if it is not known."""
    source: str = "GaussianTrimmer, Table I"
    looks: tuple[Pair, ...] = ()
    """CLIP-IQA: clear boundary, smooth boundary, complete object."""


NVOS = (
    Published("SA3D", (90.3, 91.9), (98.2, 98.5), "sa3d"),
    Published("SAGD", (90.4, 92.0), (98.2, 98.5), looks=((62.1, 68.8), (63.1, 73.8), (78.8, 83.5))),
    Published("SAGA", (90.9, 92.1), (98.3, 98.5), "saga"),
    Published("OmniSeg3D", (91.7, 92.4), (98.4, 98.7)),
    Published("FlashSplat", (91.8, 92.2), (98.6, 98.7)),
    Published("COB-GS", (92.1, 92.5), (98.6, 98.7), "cob-gs", looks=((68.2, 69.5), (73.1, 74.2), (85.9, 86.7))),
    Published("NG-GS", (92.6, None), (99.2, None), "cob-gs", "NG-GS (He et al., CVPR 2026)"),
    Published("SAGOnline", (92.7, None), None, None, "SAGOnline"),
)
"""The table of the GaussianTrimmer paper, and two later methods."""
SPIN_NERF = (Published("MVSeg", (90.9, None), (98.8, None), "usual", "SPIn-NeRF (Mirzaei et al., CVPR 2023)"),)
