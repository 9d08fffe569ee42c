"""The compiled steps of growing regions do what plain NumPy does."""

import numpy as np

from gaussian_trimmer.surface.regions import _certain_links, _merged, _mutual

RNG = np.random.default_rng(0)
REGIONS = 40
PAIRS = np.unique(np.sort(RNG.integers(0, REGIONS, (300, 2)), axis=1), axis=0)
PAIRS = PAIRS[PAIRS[:, 0] < PAIRS[:, 1]]
LINKS, SIZES = RNG.random((len(PAIRS), 6)), RNG.random((REGIONS, 2))


def test_links_of_the_same_two_regions_are_summed_and_those_within_one_are_gone():
    numbers = RNG.permutation(np.arange(REGIONS) % 12)
    pairs, links, sizes = _merged(numbers, PAIRS, LINKS, SIZES)
    ends = np.sort(numbers[PAIRS], axis=1)
    across = ends[:, 0] != ends[:, 1]
    wanted, place = np.unique(ends[across], axis=0, return_inverse=True)
    order = np.lexsort(pairs.T[::-1])
    assert np.array_equal(pairs[order], wanted)
    sums = np.stack([np.bincount(place.ravel(), column) for column in LINKS[across].T], axis=1)
    assert np.allclose(links[order], sums)
    assert np.allclose(sizes, np.stack([np.bincount(numbers, column) for column in SIZES.T], axis=1))


def test_mutual_links_are_the_strongest_of_both_regions_and_not_zero():
    strength = np.where(RNG.random(len(PAIRS)) < 0.5, 0, RNG.random(len(PAIRS)))
    strongest = [strength[(region == PAIRS).any(axis=1)].max(initial=0) for region in range(REGIONS)]
    wanted = (strength > 0) & (strength == np.array(strongest)[PAIRS].max(axis=1))
    assert np.array_equal(_mutual(PAIRS, strength, REGIONS), wanted)


def test_links_are_certain_unless_both_regions_stand_by_themselves_or_they_are_weak():
    least, weakest = np.array([0.3, 0.3]), 0.4
    size = np.sqrt(SIZES[PAIRS, 0].min(axis=1))
    both = (least < SIZES).all(axis=1)[PAIRS].all(axis=1)
    wanted = np.where(~both & (LINKS[:, 0] >= weakest * size), LINKS[:, 0] / size, 0)
    assert 0 < np.count_nonzero(wanted) < len(PAIRS)
    assert np.allclose(_certain_links(PAIRS, LINKS, SIZES, least, weakest), wanted)
