"""A ball on a floor with a needle that nobody sees: it reaches from below the floor up into the ball."""

from functools import cache

import numpy as np
import pytest
from toy import BLUE, CENTRE, ball_on_floor, check_parts, dilated, gaussians, small_config

from gaussian_trimmer.decomposition.contact import SupportPlaneSplitConfig
from gaussian_trimmer.decomposition.evidence import EvidenceConfig
from gaussian_trimmer.gaussians import concatenate
from gaussian_trimmer.rendering import get_renderer
from gaussian_trimmer.trimming.trim import RowLabel, SplitConfig, trim

BALL, TRUTH = ball_on_floor()
RENDERER = get_renderer("numba")


def with_needle(x=0.0, height=0.0, upwards=0.4):
    """The scene with the needle as its last row, and the selection, which has it."""
    needle = gaussians([[x, 0, height]], (0.12, 0.12, upwards), BLUE)
    return concatenate([BALL, needle]), np.append(dilated(BALL, TRUTH), True)


@cache
def trimmed(enabled=True, recover=True, **needle):
    scene, selection = with_needle(**needle)
    contact = SupportPlaneSplitConfig(enabled=enabled)
    evidence = EvidenceConfig(recover=recover)
    return trim(scene, selection, config=small_config(split=SplitConfig(at_support_plane=contact), evidence=evidence))


def needle_labels(result):
    """Labels of the output rows that come from the needle."""
    return sorted(result.label[result.source_index == len(BALL)].tolist())


def ghost(result):
    """What the needle's part in the background shows above the floor, in pixels of a view from the side."""
    camera = result.views[0].view.camera
    rows = np.append(
        result.background_rows, result.source_index[len(result.source_index) - len(result.outside_parts) :]
    )
    weights = RENDERER.blend_weights(result.background, camera, result.views[0].mask.astype(np.uint8), 2)
    return weights[rows == len(BALL), 1].sum()


def test_a_hidden_needle_is_cut_at_the_floor():
    result = trimmed()
    assert result.refused == ""
    assert needle_labels(result) == [RowLabel.SPLIT_INSIDE, RowLabel.SPLIT_OUTSIDE]
    part = {label: np.flatnonzero((result.source_index == len(BALL)) & (result.label == label)) for label in (3, 4)}
    upper = result.object.means[part[RowLabel.SPLIT_INSIDE][0]]
    lower = result.background.means[part[RowLabel.SPLIT_OUTSIDE][0] - len(result.object)]
    assert 0.1 < upper[2] < CENTRE[2] and lower[2] < -0.1
    check_parts(result, with_needle()[1])


def test_the_background_loses_the_ghost_and_the_scene_nothing():
    whole, cut = trimmed(enabled=False), trimmed()
    assert ghost(whole) > 100
    assert ghost(cut) < 0.3 * ghost(whole)
    camera = cut.views[0].view.camera
    before = RENDERER.render(cut.scene, camera).rgb
    after = RENDERER.render(concatenate([cut.object, cut.background]), camera).rgb
    assert np.abs(after - before).mean() < 1e-3


@pytest.mark.parametrize(
    "case",
    [
        {"enabled": False},
        {"recover": False},
        {"x": 1.8},  # Stands in the open: it is seen.
        {"height": -1.5},  # Does not reach the floor from below.
        {"height": 1.0, "upwards": 0.1},  # Lies wholly within the ball.
    ],
    ids=str,
)
def test_other_needles_stay_whole(case):
    assert len(needle_labels(trimmed(**case))) == 1


@pytest.mark.parametrize("enabled", [True, False])
def test_the_cut_at_the_floor_has_its_own_switch(enabled):
    scene, selection = with_needle()
    split = SplitConfig("none", SupportPlaneSplitConfig(enabled=enabled))
    assert trim(scene, selection, config=small_config(split=split)).count(RowLabel.SPLIT_INSIDE) == int(enabled)


def test_every_rule_keeps_the_lower_part():
    scene, selection = with_needle()
    split = SplitConfig("sagd", SupportPlaneSplitConfig(enabled=True))
    result = trim(scene, selection, config=small_config(split=split))
    assert needle_labels(result) == [RowLabel.SPLIT_INSIDE, RowLabel.SPLIT_OUTSIDE]
