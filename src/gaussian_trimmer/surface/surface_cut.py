"""Cuts of the surface graph that change which of its nodes are selected, and how well a cut separates them.

A unary term of growing strength lets ever more nodes change sides: a weak one moves only what hardly hangs on the rest,
a strong one all that may be meant. Each cut is repeated with the colours that it found on either side. Of all parts
that change sides in this way, good ones have a short boundary along concave edges and changes of colour.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from gaussian_trimmer.gaussians import BoolArray, Float64Array
from gaussian_trimmer.surface.surface_graph import SurfaceGraph

HIDDEN_UNARY = -0.05
"""Unary term of surface that is hidden in the user's view, by area in squared radii."""
_LENGTH_PENALTY = 0.25
"""How fast the score falls with the boundary's weight, relative to the root of the part's area."""


@dataclass(frozen=True, eq=False)
class SurfaceCut:
    """Which of the S nodes of a surface graph may change sides."""

    graph: SurfaceGraph
    before: BoolArray
    """Which nodes are selected before the cut, (S,)."""
    inside: bool
    """Whether nodes become selected by the cut, rather than not."""
    colour_areas: Float64Array
    """Areas of the nodes for which colour counts, zero for the others, (S,)."""
    colour_rounds: int
    """How often a cut is repeated with the colours of its parts."""

    def cuts(
        self, unaries: Float64Array, colour: float, tidied: Callable[[BoolArray], BoolArray] = lambda part: part
    ) -> Iterator[BoolArray]:
        """Yield the selected nodes after the cut, and after each repetition with colours, (S,) each.

        Args:
            unaries: as for `SurfaceGraph.cut`, (S,).
            colour: weight of the colours' log-likelihood ratio.
            tidied: what is made of each cut before the next one.
        """
        areas = self.colour_areas if self.inside else -self.colour_areas
        part = tidied(self.graph.cut(unaries))
        yield part
        for _ in range(self.colour_rounds):
            ratio, accuracy = self.graph.colour_evidence(*self.sides(part))
            part = tidied(self.graph.cut(unaries + colour * colour_weight(accuracy) * areas * ratio))
            yield part

    def sweep(
        self,
        terms: Iterable[tuple[Float64Array, float]],
        tidied: Callable[[BoolArray], BoolArray] = lambda part: part,
    ) -> Iterator[BoolArray]:
        """Yield the cuts for several unary terms and weights of colour, each once."""
        seen: set[bytes] = set()
        for unaries, colour in terms:
            for part in self.cuts(unaries, colour, tidied):
                if part.tobytes() in seen:
                    break
                seen.add(part.tobytes())
                yield part

    def sides(self, part: BoolArray) -> tuple[BoolArray, BoolArray]:
        """Return which nodes changed sides and which stayed on the side that they left, (S,) each."""
        changed = part != self.before
        return changed, (self.before != self.inside) & ~changed

    def separation(self, part: BoolArray, least_contrast: float = 0.0) -> float:
        """Return how well what changed sides is separated from what did not, about 0 to 1."""
        changed, others = self.sides(part)
        if not changed.any() or not others.any():
            return 0.0
        weight, length = self.graph.boundary(changed, others)
        _, accuracy = self.graph.colour_evidence(changed, others)
        contrast = least_contrast + (1 - weight / max(length, 1e-12))
        shortness = float(np.exp(-_LENGTH_PENALTY * weight / np.sqrt(self.graph.areas[changed].sum())))
        return contrast**2 * accuracy * shortness


def colour_weight(accuracy: float) -> float:
    """Return the weight of colour models by their balanced accuracy, 0 to 1.

    >>> colour_weight(0.5), colour_weight(1.0)
    (0.0, 1.0)
    """
    return float(np.clip((accuracy - 0.6) / 0.35, 0, 1)) ** 2
