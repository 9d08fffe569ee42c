"""Correcting the given labels in 3D, before any picture is segmented.

A rough selection is mostly right; where it is wrong, Gaussians that lie close to each other and have similar colours
carry different labels. This stage is mean-field inference in a conditional random field (CRF) over the visible
Gaussians. The label of a Gaussian follows from three things: the labels of its neighbours in the joint space of
position and colour, the colours that are typical of the object and of its surroundings, and its own given label, which
is trusted more the farther it lies from the boundary of the selection. All views share the result, so the masks drawn
from it agree with each other, and no edge has to be found in a picture that the Gaussians already determine.

The mean-field update is that of Kraehenbuehl and Koltun, "Efficient Inference in Fully Connected CRFs with Gaussian
Edge Potentials" (NeurIPS 2011), with its Gaussian kernel over position and colour restricted to the nearest neighbours.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from gaussian_trimmer.gaussians import SH_C0, BoolArray, Float64Array, FloatArray, Gaussians
from gaussian_trimmer.geometry.bounds import Bounds
from gaussian_trimmer.geometry.kd_tree import nearest
from gaussian_trimmer.geometry.support_plane import SupportPlaneConfig, find_support_plane
from gaussian_trimmer.segmentation.attached_pieces import attached_to_object
from gaussian_trimmer.settings import Range, Weight

_BINS_PER_CHANNEL = 32
"""Bins of the colour histograms in each channel."""
# Blurring by one bin's standard deviation, cut at three, as a matrix.
_BIN_STEPS = np.arange(_BINS_PER_CHANNEL) - np.arange(_BINS_PER_CHANNEL)[:, None]
_BLUR_MATRIX = np.where(np.abs(_BIN_STEPS) <= 3, np.exp(-0.5 * _BIN_STEPS.astype(np.float64) ** 2), 0.0)
_EMPTY_BIN = 1e-5
"""Added to the histograms, so that colours that occur on one side only have a finite likelihood ratio."""
_MIN_SEEN_PIXELS = 0.05
"""Visible weight above which a Gaussian counts as seen."""
_FULL_WEIGHT_PIXELS = 20.0
"""Visible weight from which on a neighbour counts no more than others."""
_MAJORITY_OF = 17
"""Number of nearest Gaussians, itself among them, whose labels decide on which side of the boundary one lies."""
_MAX_COLOUR_EVIDENCE = 2.0
"""Limit of the colour models' log-likelihood ratio."""
_CHANCE_ACCURACY = 0.5
"""Accuracy of the colour models at which their weight is zero."""
_FULL_ACCURACY_GAIN = 0.45
"""Accuracy beyond chance from which on their weight is full."""
_MAX_DISTANCES = 1.5
"""Number of boundary distances from which on trust in the given label no longer grows."""
_NEIGHBOURS_TO_OWN = 2
"""Weight of the visible neighbours' probability, relative to its own label, for a hidden Gaussian."""

_Neighbours = Annotated[int, Range(1, 256)]
_Width = Annotated[float, Range(1e-3, 100)]


@dataclass(frozen=True)
class LabelCrfConfig:
    """How the given labels are corrected by comparing Gaussians of similar position and colour."""

    enabled: bool = True
    """Correct the labels; if off, the selection alone predicts where the object is in the views."""
    passes: Annotated[int, Range(1, 100)] = 2
    """Number of rounds; each starts from the labels that the one before has corrected."""
    iterations: Annotated[int, Range(1, 1000)] = 5
    """Number of mean-field updates in each round."""
    k_neighbours: _Neighbours = 32
    """Number of nearest neighbours in position and colour whose labels a Gaussian follows."""
    k_hidden_neighbours: _Neighbours = 8
    """Number of nearest visible Gaussians that decide the label of a hidden one."""
    position_sigma: _Width = 0.12
    """Standard deviation of the kernel over position, relative to the object's radius."""
    colour_sigma: _Width = 0.08
    """Standard deviation of the kernel over colour, for channels in [0, 1]."""
    smoothness: Weight = 4.0
    """Weight of the neighbours' mean label."""
    colour: Weight = 1.3
    """Weight of the colour models' log-likelihood ratio where they separate object and surroundings well."""
    trust: Weight = 1.0
    """Weight of the given label at the boundary of the selection."""
    interior_trust: Weight = 2.0
    """Weight that the given label gains away from the boundary: times the squared distance from it, measured in
    boundary distances, up to 1.5 of them."""
    boundary_distance: _Width = 0.12
    """Unit of that distance, relative to the object's radius."""
    resting: Weight = 1.0
    """Weight away from the object of selected Gaussians that lie in the support plane."""
    support_plane: SupportPlaneConfig = field(default_factory=SupportPlaneConfig)


def correct_labels(
    gaussians: Gaussians, selection: BoolArray, visible: FloatArray, bounds: Bounds, config: LabelCrfConfig
) -> FloatArray:
    """Probability that each Gaussian belongs to the object, (N,).

    Args:
        gaussians: the selected object and the Gaussians around it.
        selection: the given labels, (N,).
        visible: blend weight of each Gaussian summed over the views, in pixels of five views of 512 x 512, (N,).
        bounds: the object's robust bounds.
        config: weights of the terms.

    Gaussians that no view shows take a third of their probability from their given label and the rest from the visible
    Gaussians around them. Otherwise what lies hidden inside an object would stay behind as a ghost of it, and what lies
    hidden in the table below would come along with it.
    """
    probability = selection.astype(np.float32)
    seen = np.flatnonzero(visible > _MIN_SEEN_PIXELS)
    labels = selection[seen]
    if not config.enabled or labels.all() or not labels.any():
        return probability
    positions = gaussians.means[seen] / np.float32(bounds.radius)
    colours = np.clip(0.5 + SH_C0 * gaussians.sh_dc[seen], 0, 1).astype(np.float32)
    crf = _Crf(positions, colours, visible[seen].astype(np.float64), bounds, config)
    for _ in range(config.passes):
        corrected = crf.infer(labels)
        labels = corrected > 0.5
        if labels.all() or not labels.any():
            break
    probability[seen] = corrected
    hidden = np.flatnonzero(visible <= _MIN_SEEN_PIXELS)
    _, near = nearest(
        positions, gaussians.means[hidden] / np.float32(bounds.radius), min(config.k_hidden_neighbours, len(seen))
    )
    around = corrected[near].mean(axis=1)
    probability[hidden] = (probability[hidden] + _NEIGHBOURS_TO_OWN * around) / (1 + _NEIGHBOURS_TO_OWN)
    return probability


class _Crf:
    """The conditional random field over the S visible Gaussians, built once for all rounds."""

    def __init__(
        self, positions: FloatArray, colours: FloatArray, weights: Float64Array, bounds: Bounds, config: LabelCrfConfig
    ) -> None:
        self.positions, self.weights, self.bounds, self.config = positions, weights, bounds, config
        capped = np.minimum(weights, _FULL_WEIGHT_PIXELS)
        features = np.concatenate([positions / config.position_sigma, colours / config.colour_sigma], axis=1)
        squared, self.alike = _others(features, config.k_neighbours)
        kernel = np.exp(-0.5 * squared) * capped[self.alike]
        self.kernel = (kernel / (kernel.sum(axis=1, keepdims=True) + 1e-9)).astype(np.float32)
        squared, self.near = nearest(positions, positions, min(_MAJORITY_OF, len(positions)))
        self.spacing = np.sqrt(squared[:, min(1, squared.shape[1] - 1)])
        self.near_weights = capped[self.near]
        bins = np.minimum((colours * _BINS_PER_CHANNEL).astype(np.int64), _BINS_PER_CHANNEL - 1)
        self.colour_bins = (bins[:, 0] * _BINS_PER_CHANNEL + bins[:, 1]) * _BINS_PER_CHANNEL + bins[:, 2]

    def infer(self, labels: BoolArray) -> FloatArray:
        """One round of mean-field inference from labels (S,), as probabilities (S,)."""
        config = self.config
        signs = np.where(labels, 1.0, -1.0).astype(np.float32)
        unary = self._trust(labels, signs)
        _, separation = self._colour_evidence(labels.astype(np.float64))
        colour_weight = config.colour * float(np.clip((separation - _CHANCE_ACCURACY) / _FULL_ACCURACY_GAIN, 0, 1)) ** 2
        mean = np.sign(unary)
        for _ in range(config.iterations):
            evidence, _ = self._colour_evidence(0.5 * (mean + 1.0))
            followed = np.einsum("nk,nk->n", self.kernel, mean[self.alike])
            mean = np.tanh(0.5 * (unary + config.smoothness * followed + colour_weight * evidence)).astype(np.float32)
        return np.asarray(0.5 * (mean + 1), np.float32)

    def _trust(self, labels: BoolArray, signs: FloatArray) -> FloatArray:
        """Log-odds of each Gaussian by its own label, its distance from the boundary, and the support plane, (S,)."""
        config = self.config
        reach = _MAX_DISTANCES * config.boundary_distance
        distance = np.minimum(self._distance_to_boundary(signs, reach) / config.boundary_distance, _MAX_DISTANCES)
        unary = np.asarray((config.trust + config.interior_trust * distance**2) * signs, np.float32)
        plane = find_support_plane(self.positions, labels, self.weights, self.bounds, config.support_plane)
        if plane is None:
            return unary
        attached = attached_to_object(self.positions, self.spacing, labels, self.weights, plane, config.support_plane)
        unary = np.where(attached, np.float32(0), unary)  # that they are not selected says nothing
        resting = plane.on_surface & labels
        return np.asarray(np.where(resting, np.minimum(unary, config.trust) - config.resting, unary), np.float32)

    def _distance_to_boundary(self, signs: FloatArray, reach: float) -> FloatArray:
        """Distance of each Gaussian from the nearest one on the other side, infinite from `reach` on, (S,).

        The sides are the local majorities of the labels. If all Gaussians are on one side, there is no boundary, and
        the distance is zero.
        """
        majority = np.sum(signs[self.near] * self.near_weights, axis=1) > 0
        distance = np.zeros(len(signs), np.float32)
        if majority.any() and not majority.all():
            for side in (True, False):
                squared, _ = nearest(self.positions[majority != side], self.positions[majority == side], 1, reach)
                distance[majority == side] = np.sqrt(squared[:, 0])
        return distance

    def _colour_evidence(self, object_share: NDArray[np.floating]) -> tuple[Float64Array, float]:
        """Clipped log-likelihood ratio of each Gaussian's colour (S,), and how well it separates the labels.

        The models are blurred colour histograms of object and surroundings, weighted by visibility. The second value is
        the balanced accuracy with which the sign of the ratio predicts the labels, 0.5 at chance.
        """
        inside, outside = self.weights * object_share, self.weights * (1 - object_share)
        models = [_blurred_histogram(self.colour_bins, weights) for weights in (inside, outside)]
        ratio = np.log((models[0] + _EMPTY_BIN) / (models[1] + _EMPTY_BIN))[self.colour_bins]
        hits = inside @ (ratio > 0) / max(inside.sum(), 1e-12), outside @ (ratio < 0) / max(outside.sum(), 1e-12)
        return np.clip(ratio, -_MAX_COLOUR_EVIDENCE, _MAX_COLOUR_EVIDENCE), float(np.mean(hits))


def _others(features: FloatArray, k: int) -> tuple[FloatArray, NDArray[np.int32]]:
    """Squared distances and indices of the k nearest other points of each, (S, k); fewer columns for few points."""
    k = min(k, len(features) - 1)
    squared, indices = nearest(features, features, k + 1)
    return squared[:, 1:], indices[:, 1:]


def _blurred_histogram(bins: NDArray[np.int64], weights: Float64Array) -> Float64Array:
    """Normalised colour histogram, blurred by one bin's standard deviation, flat."""
    counts = np.bincount(bins, weights, _BINS_PER_CHANNEL**3).reshape((_BINS_PER_CHANNEL,) * 3)
    for _ in range(3):  # The last axis is blurred and comes first, so that after three times all are in order again.
        counts = np.moveaxis(counts @ _BLUR_MATRIX, 2, 0)  # many small products, for which no threads are woken
    return np.asarray((counts / max(counts.sum(), 1e-12)).reshape(-1))
