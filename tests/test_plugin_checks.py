"""Segmenters of one's own that break their contract: one sentence that names them, whatever is wrong."""

import numpy as np
import pytest
import toy

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.trimming.config import PlanConfig, SplitConfig
from gaussian_trimmer.trimming.trim import trim

SCENE, TRUTH = toy.ball_on_floor(n_floaters=0)
CONFIG = toy.small_config(plan=PlanConfig(size=64, views=2), split=SplitConfig("plane"))


class Silhouettes:
    """A segmenter that gives the expected silhouettes after a change of one's choice."""

    name = "homemade"

    def __init__(self, change):
        self.change = change

    def segment(self, views):
        return self.change([view.silhouette for view in views])


@toy.one_thread()
def trimmed(segmenter="silhouette"):
    return trim(SCENE, toy.dilated(SCENE, TRUTH), config=CONFIG, segmenter=segmenter)


@pytest.fixture(scope="module")
def expected():
    return trimmed(Silhouettes(lambda masks: masks))


class Together(Silhouettes):
    """A segmenter that asks for the Gaussians as well."""

    def segment(self, views):
        pytest.fail("segment_together is there")

    def segment_together(self, views, gaussians):
        assert len(gaussians) > 0
        return Silhouettes.segment(self, views)


def test_segmenters_may_ask_for_the_gaussians_and_are_checked_all_the_same(expected):
    result = trimmed(Together(lambda masks: masks))
    np.testing.assert_array_equal(result.objects[0].source_index, expected.objects[0].source_index)
    with pytest.raises(InputError, match="segmenter 'homemade'"):
        trimmed(Together(lambda masks: masks[:1]))


@pytest.mark.parametrize(
    "change",
    [
        lambda masks: [np.uint8(255) * mask for mask in masks],
        lambda masks: np.stack(masks).astype(np.uint8),
        lambda masks: [mask.astype(np.int64) for mask in masks],
        lambda masks: [mask.astype(np.int32) * 200 + 20 for mask in masks],
        lambda masks: [masks[0], masks[1] * np.uint8(255)],
        lambda masks: (mask.tolist() for mask in masks),
    ],
    ids=["0 and 255", "0 and 1 stacked", "int64", "coverage", "bool and uint8", "lists"],
)
def test_masks_of_whole_numbers_mean_the_same_as_booleans(change, expected):
    result = trimmed(Silhouettes(change))
    np.testing.assert_array_equal(result.objects[0].source_index, expected.objects[0].source_index)
    for ours, theirs in zip(result.objects[0].views, expected.objects[0].views, strict=True):
        assert ours.mask.dtype == np.bool_
        np.testing.assert_array_equal(ours.mask, theirs.mask)


@pytest.mark.parametrize(
    "change",
    [
        lambda masks: masks[:1],
        lambda masks: [mask[:-1] for mask in masks],
        lambda masks: [mask[..., None] for mask in masks],
        lambda masks: [np.float32(mask) for mask in masks],
        lambda masks: [mask.astype(object) for mask in masks],
        lambda masks: [mask * np.uint8(3) for mask in masks],
        lambda masks: [mask * np.int16(-1) for mask in masks],
        lambda masks: [mask * np.int32(1000) for mask in masks],
        lambda masks: None,
        lambda masks: [masks[0], [[1], [1, 2]]],
    ],
)
def test_masks_that_cannot_be_used_are_named(change):
    with pytest.raises(InputError, match="segmenter 'homemade' gave"):
        trimmed(Silhouettes(change))


def test_a_segmenter_without_a_name_is_called_by_its_class():
    class Nameless:
        def segment(self, views):
            return []

    with pytest.raises(InputError, match="'Nameless' gave"):
        trimmed(Nameless())
