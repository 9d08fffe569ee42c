"""A trim that would take most of the selection away must not stand."""

import numpy as np
import pytest
from toy import ball_on_floor, jaccard, object_rows, small_config

from gaussian_trimmer.config import AcceptanceConfig, SplitConfig
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.pipeline import trim

WHOLE = SplitConfig("none")


def translucent_ball(n, logit):
    scene, truth = ball_on_floor(n_ball=n)
    opacities = np.array(scene.opacity_logits)
    opacities[truth] = logit
    return scene.replace(opacity_logits=opacities), truth


def test_a_trim_that_would_leave_little_is_refused_and_the_selection_returned():
    scene, truth = translucent_ball(150, -1.4)
    bold = small_config(split=WHOLE, acceptance=AcceptanceConfig(min_remaining=0.0))
    assert jaccard(object_rows(trim(scene, truth, config=bold)), truth) < 0.4  # the case is one where trimming fails
    result = trim(scene, truth, config=small_config(split=WHOLE))
    assert "would remain; 0.4 is needed" in result.refused
    np.testing.assert_array_equal(object_rows(result), truth)


def test_a_trim_that_leaves_most_of_it_stands():
    scene, truth = ball_on_floor()
    assert trim(scene, truth, config=small_config(split=WHOLE)).refused == ""


@pytest.mark.parametrize("value", [-0.1, float("nan")])
def test_a_limit_without_meaning_is_refused(value):
    scene, truth = ball_on_floor(n_ball=100)
    with pytest.raises(InputError, match="min-remaining"):
        trim(scene, truth, config=small_config(acceptance=AcceptanceConfig(min_remaining=value)))
