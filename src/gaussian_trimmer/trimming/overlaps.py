"""Which of several objects gets a Gaussian that more than one of them asks for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gaussian_trimmer.gaussians import Gaussians, IntArray, LabelArray
from gaussian_trimmer.geometry.graphs import nearest

_VOTING_NEIGHBOURS = 8
"""Number of nearest Gaussians that decide to which of several objects one belongs."""


def resolve_overlaps(
    scene: Gaussians, claims: Sequence[IntArray], selections: Sequence[IntArray]
) -> tuple[LabelArray, int]:
    """Give each Gaussian to one object: the one whose selection had it, or else the one of most of its neighbours.

    Of equal votes the first object wins. Whoever does not ask for a Gaussian never gets it.

    Args:
        scene: all N Gaussians.
        claims: scene rows of what each object asks for, ascending.
        selections: scene rows of what was selected of each, ascending.

    Returns:
        The number of each Gaussian's object, counted from 1, or 0 for none, (N,), and how many were contested.
    """
    owner, count = np.zeros(len(scene), np.int32), np.zeros(len(scene), np.int32)
    for number, rows in enumerate(claims, 1):
        owner[rows] = np.where(count[rows] > 0, owner[rows], number)
        count[rows] += 1
    contested = np.flatnonzero(count > 1)
    if not len(contested):
        return owner, 0
    claims = [rows[count[rows] > 1] for rows in claims]
    selectors = np.zeros(len(scene), np.int32)
    for rows, selected in zip(claims, selections, strict=True):
        selectors[np.intersect1d(rows, selected, assume_unique=True)] += 1
    for number, (rows, selected) in enumerate(zip(claims, selections, strict=True), 1):
        chosen = np.intersect1d(rows, selected, assume_unique=True)
        owner[chosen[selectors[chosen] == 1]] = number
    _vote(scene, owner, [rows[selectors[rows] != 1] for rows in claims], np.flatnonzero(count == 1))
    return owner, len(contested)


def _vote(scene: Gaussians, owner: LabelArray, claims: Sequence[IntArray], settled: IntArray) -> None:
    """Write into `owner` which of the objects that claim a Gaussian most of its settled neighbours belong to."""
    unclear = np.unique(np.concatenate(claims))
    if not len(unclear) or not len(settled):
        return
    _, near = nearest(scene.means[settled], scene.means[unclear], min(_VOTING_NEIGHBOURS, len(settled)))
    voters, most = owner[settled[near]], np.full(len(unclear), -1)
    for number, rows in enumerate(claims, 1):
        places = np.searchsorted(unclear, rows)
        votes = (voters[places] == number).sum(axis=1)
        better = votes > most[places]
        owner[rows[better]], most[places[better]] = number, votes[better]
