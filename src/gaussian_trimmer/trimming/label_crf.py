"""Correcting the given labels in 3D, before any picture is segmented.

A rough selection is mostly right; where it is wrong, Gaussians that lie close to each other and have similar colours
carry different labels. This stage is mean-field inference in a conditional random field (CRF) over the visible
Gaussians. The label of a Gaussian follows from three things: the labels of its neighbours in the joint space of
position and colour, the colours that are typical of the object and of its surroundings, and its own given label, which
is trusted more the farther it lies from the boundary of the selection. All views share the result, so the masks drawn
from it agree with each other, and no edge has to be found in a picture that the Gaussians already determine.

How often a selection is wrong is not known, and it differs from side to side: one that is too wide has everything of
the object, and one that is too narrow has nothing else. So the field is solved twice. The first solution tells how
often the labels of either side are wrong, near the boundary and where they contradict what is around them, and the
second one trusts them accordingly. A piece that stands against the object has no label in the first one, where its
colours and neighbours speak for themselves: it may be an arm that was missed, or another thing. Nor has what is
selected of the surface below, which may be the object's foot: how often such labels are wrong is estimated for them
alone. This is one step of the expectation-maximisation for noisy labels of Dawid and Skene, "Maximum Likelihood
Estimation of Observer Error-Rates Using the EM Algorithm" (Applied Statistics, 1979).

The mean-field update is that of Kraehenbuehl and Koltun, "Efficient Inference in Fully Connected CRFs with Gaussian
Edge Potentials" (NeurIPS 2011), with its Gaussian kernel over position and colour restricted to the nearest neighbours.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.gaussians import SH_C0, BoolArray, Float64Array, FloatArray, Gaussians, IntArray, logit, sigmoid
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.geometry.graphs import nearest
from gaussian_trimmer.geometry.support_plane import SupportPlaneConfig, find_support_plane, pieces_of_object
from gaussian_trimmer.settings import Range, Weight
from gaussian_trimmer.views.view import MIN_SEEN_PIXELS

_HALF_COUNTED_PIXELS = 1.0
"""Visible weight at which a neighbour counts half."""
_MAX_DISTANCE = 1.5
"""Distance from the boundary beyond which trust in the given label is constant, in standard deviations of the
kernel over position."""
_GROUPS = 5
"""Groups of labels that are wrong equally often: not selected and selected, each against the majority around it and
with it; and selected in the plane that the object stands on, the last one."""

_Neighbours = Annotated[int, Range(1, 256)]
_Width = Annotated[float, Range(1e-3, 100)]


@dataclass(frozen=True)
class LabelCrfConfig:
    """How the given labels are corrected by comparing Gaussians of similar position and colour."""

    enabled: bool = True
    """Correct the labels; if off, the selection alone predicts where the object is in the views."""
    iterations: Annotated[int, Range(1, 1000)] = 10
    """Number of mean-field updates in each of two rounds."""
    k_neighbours: _Neighbours = 32
    """Number of nearest neighbours in position and colour whose labels a Gaussian follows. The majority of half as
    many, the nearest in position, and itself decides on which side of the selection's boundary it lies."""
    position_sigma: _Width = 0.12
    """Standard deviation of the kernel over position, relative to the object's radius; also the largest gap within one
    piece of what stands on the support plane, unless the nearest Gaussians lie farther apart, and how far such a piece
    may reach beyond the selection's bounds."""
    colour_sigma: _Width = 0.08
    """Standard deviation of the kernel over colour, and width of the colour models' bins, for channels in [0, 1]."""
    smoothness: Weight = 4.0
    """Weight of the neighbours' mean label."""
    colour: Weight = 1.3
    """Weight of the colour models' log-likelihood ratio."""
    trust: Weight = 1.0
    """Weight of the given label at the boundary of the selection in the first round."""
    interior_trust: Weight = 2.0
    """Weight that the given label gains away from the boundary: times the squared distance from it, measured in
    standard deviations of the kernel over position, up to 1.5 of them."""
    support_plane: SupportPlaneConfig = field(default_factory=SupportPlaneConfig)


def correct_labels(
    gaussians: Gaussians, selection: BoolArray, visible: FloatArray, bounds: Bounds, config: LabelCrfConfig
) -> FloatArray:
    """Return the probability that each Gaussian belongs to the object, (N,).

    Args:
        gaussians: the selected object and the Gaussians around it.
        selection: the given labels, (N,).
        visible: blend weight of each Gaussian summed over the views, in pixels of five views of 512 x 512, (N,).
        bounds: the object's robust bounds.
        config: weights of the terms.

    Gaussians that no view shows follow the visible ones around them, and are otherwise ignored. Otherwise what
    lies hidden inside an object would stay behind as a ghost of it, and what lies hidden in the table below would come
    along with it.
    """
    probability = selection.astype(np.float32)
    is_seen = visible > MIN_SEEN_PIXELS
    labels = selection[is_seen]
    if not config.enabled or labels.all() or not labels.any():
        return probability
    positions = gaussians.means / np.float32(bounds.radius)
    colours = np.clip(0.5 + SH_C0 * gaussians.sh_dc, 0, 1).astype(np.float32)
    weights = visible[is_seen].astype(np.float64)
    crf = _Crf(positions[is_seen], colours[is_seen], weights, labels, bounds, config)
    first = crf.infer(np.full(_GROUPS, config.trust), believes_contradicted=False)
    probability[is_seen] = crf.infer(crf.estimated_trust(first), believes_contradicted=True)
    hidden = ~is_seen
    probability[hidden] = crf.infer_hidden(positions[hidden], colours[hidden], selection[hidden], probability[is_seen])
    return probability


class _Crf:
    """The conditional random field over the S visible Gaussians."""

    def __init__(
        self,
        positions: FloatArray,
        colours: FloatArray,
        weights: Float64Array,
        labels: BoolArray,
        bounds: Bounds,
        config: LabelCrfConfig,
    ) -> None:
        self.positions, self.weights, self.labels, self.config = positions, weights, labels, config
        self.importance = weights / (weights + _HALF_COUNTED_PIXELS)
        self.features = _features(positions, colours, config)
        squared, self.alike = _others(self.features, config.k_neighbours)
        self.kernel = self._kernel(squared, self.alike)
        self.colour, self.n_colours = _colour_bins(colours, config.colour_sigma)
        self.label_sign = np.where(labels, np.float32(1), np.float32(-1))
        squared, near = nearest(positions, positions, min(config.k_neighbours // 2 + 1, len(positions)))
        majority = np.sum(self.label_sign[near] * self.importance[near], axis=1) > 0
        self.distance = _distance_to_boundary(positions, majority, _MAX_DISTANCE * config.position_sigma)
        self.distance /= config.position_sigma
        self.label_matches_majority = labels == majority
        # Large Gaussians are one piece though their centres lie farther apart than the kernel reaches.
        gap = max(config.position_sigma, float(np.sqrt(np.median(squared[labels, -1]))))
        self._find_pieces(gap, bounds)
        self.group = np.where(self.in_plane, _GROUPS - 1, 2 * labels + self.label_matches_majority)

    def infer(self, trust: Float64Array, believes_contradicted: bool) -> FloatArray:
        """Solve the field, as probabilities (S,).

        Args:
            trust: weight of a label at the boundary, for each group, (G,).
            believes_contradicted: whether labels that the plane contradicts have that weight, too; otherwise they have
                none.
        """
        config = self.config
        label_weight = trust[self.group]
        unary_weight = label_weight + config.interior_trust * self.distance**2
        contradicted = self.attached | self.in_plane
        unary = np.where(contradicted, label_weight if believes_contradicted else 0, unary_weight) * self.label_sign
        mean = np.sign(unary)
        for _ in range(config.iterations):
            followed = np.einsum("nk,nk->n", self.kernel, mean[self.alike])
            pairwise = config.smoothness * followed + config.colour * self._colour_ratio(0.5 * (mean + 1))
            mean = np.tanh(0.5 * (unary + pairwise)).astype(np.float32)
        return np.asarray(0.5 * (mean + 1), np.float32)

    def estimated_trust(self, probability: FloatArray) -> Float64Array:
        """Return log-odds that labels are right, by a solution (S,): of each group, near the boundary, (G,)."""
        wrong = np.where(self.labels, 1 - probability, probability)
        counts = self.importance * ((self.distance < 1) | ~self.label_matches_majority | self.in_plane)
        total = np.bincount(self.group, counts, _GROUPS)
        sums = np.bincount(self.group, counts * wrong, _GROUPS)
        error = (sums + 1) / (total + 2)  # by the rule of succession, so that no label is beyond doubt
        return -logit(np.minimum(error, 0.5))  # labels that are mostly wrong say nothing

    def infer_hidden(
        self, positions: FloatArray, colours: FloatArray, labels: BoolArray, probability: FloatArray
    ) -> FloatArray:
        """Return probabilities (H,) of hidden Gaussians by their labels (H,) and those of the visible ones (S,)."""
        features = _features(positions, colours, self.config)
        squared, near = nearest(self.features, features, min(self.config.k_neighbours, len(self.features)))
        followed = np.einsum("nk,nk->n", self._kernel(squared, near), 2 * probability[near] - 1)
        own = self.config.trust * np.where(labels, 1.0, -1.0)
        return sigmoid(np.asarray(own + self.config.smoothness * followed, np.float32))

    def _kernel(self, squared: FloatArray, neighbours: NDArray[np.int32]) -> FloatArray:
        """Return weights of neighbours at squared distances (N, k), which sum up to one, (N, k)."""
        kernel = np.exp(-0.5 * squared) * self.importance[neighbours]
        return np.asarray(kernel / (kernel.sum(axis=1, keepdims=True) + 1e-9), np.float32)

    def _find_pieces(self, gap: float, bounds: Bounds) -> None:
        """Tell by the support plane what is above it, and which labels it contradicts or confirms, (S,) each.

        It contradicts those of Gaussians that are not selected, in pieces above it that are partly selected,
        `attached`, and of selected ones in it, `in_plane`. A piece above it that is selected as a whole is the
        object's `own`.

        Args:
            gap: largest step within a piece, in object radii.
            bounds: the object's bounds.
        """
        config = self.config.support_plane
        self.attached = self.in_plane = self.own = np.zeros(len(self.labels), np.bool_)
        self.above = ~self.own
        plane = find_support_plane(self.positions, self.labels, self.weights, bounds, config)
        if plane is not None:
            self.above, self.in_plane = plane.above, plane.on_surface & self.labels
            self.attached, self.own = pieces_of_object(
                self.positions, self.labels, self.weights, plane, gap, self.config.position_sigma, config
            )

    def _colour_ratio(self, object_share: NDArray[np.floating]) -> Float64Array:
        """Return the log-likelihood ratio of each Gaussian's colour, by the object's share of each Gaussian, (S,).

        The models are colour histograms of object and surroundings, weighted by visibility, each averaged with an even
        one so that colours that occur on one side only have a finite ratio. Fewer pixels than there are colours say
        little: where nearly everything is selected, nobody knows what the surroundings look like. Nor do the
        colours of the ground speak against what is selected as one piece above it, such as a plinth of the same stone.
        """
        rest = self.weights * (1 - object_share)
        surroundings = np.where(self.own, self._model(rest, self.above), self._model(rest))
        return np.asarray(np.log(self._model(self.weights * object_share) / surroundings))

    def _model(self, weights: Float64Array, counted: BoolArray | bool = True) -> Float64Array:
        """Return the share that each Gaussian's colour has of given weights, by those that are counted, (S,)."""
        held = np.bincount(self.colour, weights * counted)
        return np.asarray((held / (weights.sum() + self.n_colours) + 1 / self.n_colours)[self.colour])


def _features(positions: FloatArray, colours: FloatArray, config: LabelCrfConfig) -> FloatArray:
    return np.concatenate([positions / config.position_sigma, colours / config.colour_sigma], axis=1, dtype=np.float32)


def _others(features: FloatArray, k: int) -> tuple[FloatArray, NDArray[np.int32]]:
    """Find squared distances and indices of the k nearest other points of each, (S, k); fewer for few points."""
    k = min(k, len(features) - 1)
    squared, indices = nearest(features, features, k + 1)
    return squared[:, 1:], indices[:, 1:]


def _distance_to_boundary(positions: FloatArray, inside: BoolArray, reach: float) -> FloatArray:
    """Return the distance of each Gaussian from the nearest one on the other side, at most `reach`, (S,).

    If all Gaussians are on one side, there is no boundary, and the distance is zero.
    """
    distance = np.zeros(len(positions), np.float32)
    if inside.any() and not inside.all():
        for side in (True, False):
            squared, _ = nearest(positions[inside != side], positions[inside == side], 1, reach)
            distance[inside == side] = np.minimum(np.sqrt(squared[:, 0]), reach)
    return distance


def _colour_bins(colours: FloatArray, width: float) -> tuple[IntArray, int]:
    """Return the number of each colour's bin among those that occur, (S,), and how many bins there are in all."""
    per_channel = max(1, int(np.ceil(1 / width)))
    bins = np.minimum((colours * per_channel).astype(np.int64), per_channel - 1)
    _, occurring = np.unique((bins[:, 0] * per_channel + bins[:, 1]) * per_channel + bins[:, 2], return_inverse=True)
    return occurring, per_channel**3
