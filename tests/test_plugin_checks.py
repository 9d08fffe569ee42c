"""Renderers and segmenters of one's own that break their contract: one sentence that names them, whatever is wrong."""

from dataclasses import replace

import numpy as np
import pytest
import toy

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.rendering.numba_cpu import NumbaRenderer
from gaussian_trimmer.trimming.trim import PlanConfig, SplitConfig, trim

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
def trimmed(segmenter="silhouette", renderer="numba"):
    return trim(SCENE, toy.dilated(SCENE, TRUTH), config=CONFIG, renderer=renderer, segmenter=segmenter)


@pytest.fixture(scope="module")
def expected():
    return trimmed(Silhouettes(lambda masks: masks))


class Together(Silhouettes):
    """A segmenter that asks for the Gaussians as well."""

    def segment(self, views):
        pytest.fail("segment_together is there")

    def segment_together(self, views, gaussians, renderer):
        assert len(gaussians) > 0
        assert renderer.name == "numba"
        return Silhouettes.segment(self, views)


def test_segmenters_may_ask_for_the_gaussians_and_are_checked_all_the_same(expected):
    result = trimmed(Together(lambda masks: masks))
    np.testing.assert_array_equal(result.source_index, expected.source_index)
    with pytest.raises(InputError, match="segmenter 'homemade' gave 1 masks for 2 views"):
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
    np.testing.assert_array_equal(result.source_index, expected.source_index)
    for ours, theirs in zip(result.views, expected.views, strict=True):
        assert ours.mask.dtype == np.bool_
        np.testing.assert_array_equal(ours.mask, theirs.mask)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda masks: masks[:1], "1 masks for 2 views"),
        (lambda masks: [mask[:-1] for mask in masks], r"shape \(63, 64\) for view 0; \(64, 64\) is needed"),
        (lambda masks: [mask[..., None] for mask in masks], r"shape \(64, 64, 1\)"),
        (lambda masks: [np.float32(mask) for mask in masks], "type float32 for view 0; booleans are needed"),
        (lambda masks: [mask.astype(object) for mask in masks], "type object"),
        (lambda masks: [mask * np.uint8(3) for mask in masks], "whole numbers from 0 to 3"),
        (lambda masks: [mask * np.int16(-1) for mask in masks], "whole numbers from -1 to 0"),
        (lambda masks: [mask * np.int32(1000) for mask in masks], "whole numbers from 0 to 1000"),
        (lambda masks: None, "NoneType, which is no sequence"),
        (lambda masks: [masks[0], [[1], [1, 2]]], "no sequence of NumPy arrays"),
    ],
)
def test_masks_that_cannot_be_used_are_named(change, sentence):
    with pytest.raises(InputError, match=f"segmenter 'homemade' gave .*{sentence}"):
        trimmed(Silhouettes(change))


class Nameless:
    """A segmenter without a name."""

    def segment(self, views):
        return []


@pytest.mark.parametrize(
    ("segmenter", "sentence"),
    [
        (Nameless(), "'Nameless' gave 0 masks for 2 views"),
        (Silhouettes, "Silhouettes is a class; give an object of it"),
        (lambda views: [], "segmenter 'function' has no method segment"),
    ],
)
def test_what_is_no_segmenter_is_named(segmenter, sentence):
    with pytest.raises(InputError, match=sentence):
        trimmed(segmenter)


class Homemade(NumbaRenderer):
    """A renderer whose answers to one method are changed."""

    name = "homemade"

    def __init__(self, method, change):
        super().__init__()

        def changed(*arguments, **named):
            return change(getattr(NumbaRenderer, method)(self, *arguments, **named))

        setattr(self, method, changed)


@pytest.mark.parametrize(
    ("method", "change", "sentence"),
    [
        ("render", lambda r: replace(r, rgb=r.rgb[..., :2]), r"type float32 from render\(...\).rgb; .* \(64, 64, 3\)"),
        ("render", lambda r: replace(r, alpha=r.alpha > 0.5), r"type bool from render\(...\).alpha; .*floats"),
        ("render", lambda r: replace(r, depth=r.depth.T[:5]), r"shape \(5, 64\) .* from render\(...\).depth"),
        ("render", lambda r: replace(r, weights=np.zeros(0, np.float32)), r"weights=True\).weights; .*\(\d+,\)"),
        ("render", lambda r: r.rgb, r"gave nothing from render\(...\).rgb"),
        ("blend_values", lambda v: v[..., 0], r"from blend_values; a NumPy array of shape \(\d+, \d+, \d\)"),
        ("blend_weights", lambda w: w.T, r"from blend_weights; a NumPy array of shape \(\d+, \d\)"),
        ("blend_weights", lambda w: w.tolist(), "gave a list from blend_weights"),
        ("top_contributors", lambda found: found[0], "must give rows and weights from top_contributors"),
        ("top_contributors", lambda f: (f[0].astype(np.float32), f[1]), "top_contributors, rows; .* of whole numbers"),
        ("top_contributors", lambda f: (f[0], f[1][:, :1]), "from top_contributors, weights"),
    ],
)
def test_answers_of_a_renderer_that_cannot_be_used_are_named(method, change, sentence):
    with pytest.raises(InputError, match=f"renderer 'homemade' .*{sentence}"):
        trimmed(Silhouettes(tight), Homemade(method, change))


def tight(masks):
    """Masks without their rim, so that Gaussians are looked at that straddle it."""
    return [mask & np.roll(mask, 2, 0) & np.roll(mask, -2, 0) & np.roll(mask, 2, 1) & np.roll(mask, -2, 1)
            for mask in masks]  # fmt: skip


def test_a_renderer_that_lacks_methods_is_named_before_anything_is_rendered():
    class Halfway:
        name = "halfway"

        def render(self, *arguments):
            raise AssertionError

        def blend_values(self, *arguments):
            raise AssertionError

    with pytest.raises(InputError, match="'halfway' has no method blend_weights and no method top_contributors"):
        trimmed(renderer=Halfway())
