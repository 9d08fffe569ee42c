"""A trim that would take most of the selection away must not stand."""

import numpy as np
import toy
from toy import CENTRE, RADIUS, ball_on_floor, gaussians, jaccard, object_rows, small_config

from gaussian_trimmer.gaussians import concatenate
from gaussian_trimmer.trimming.config import AcceptanceConfig, EvidenceConfig, PlanConfig, SplitConfig, paper_config
from gaussian_trimmer.trimming.trim import trim

WHOLE = SplitConfig("none")


def _silhouette(view):
    return view.silhouette


def translucent_ball(n, logit):
    scene, truth = ball_on_floor(n_ball=n)
    opacities = np.array(scene.opacity_logits)
    opacities[truth] = logit
    return scene.replace(opacity_logits=opacities), truth


def test_a_trim_that_would_leave_little_is_refused_and_the_selection_returned():
    scene, truth = translucent_ball(300, -1.8)
    masks_alone = EvidenceConfig(prior=0.0)
    bold = small_config(split=WHOLE, evidence=masks_alone, acceptance=AcceptanceConfig(max_wrong=1.0))
    harmed = toy.trim_by(_silhouette, scene, truth, config=bold)
    assert jaccard(object_rows(harmed), truth) < 0.4  # the case is one where trimming fails
    result = toy.trim_by(_silhouette, scene, truth, config=small_config(split=WHOLE, evidence=masks_alone))
    assert "would remain; 0.40 is needed" in result.objects[0].refused
    np.testing.assert_array_equal(object_rows(result), truth)


def ball_among_leaves(logit):
    """The ball, and around it a dome of 80 green Gaussians that hide most of it from above and from all sides."""
    scene, truth = ball_on_floor()
    outward = np.random.default_rng(0).normal(size=(80, 3))
    outward[:, 2] = np.abs(outward[:, 2])
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    leaves = gaussians(CENTRE + 2.2 * RADIUS * outward, 0.3, (0.2, 0.6, 0.2))
    leaves = leaves.replace(opacity_logits=np.full(80, logit, np.float32))
    return concatenate([scene, leaves]), np.append(truth, np.zeros(80, np.bool_))


def test_an_object_that_other_things_hide_in_most_views_is_left_as_it_was():
    scene, truth = ball_among_leaves(3.0)
    all_around = PlanConfig(size=160, yaw_range_degrees=(0, 360))
    result = trim(scene, truth, config=small_config(plan=all_around))
    assert "something nearer hides 0." in result.objects[0].refused
    assert "0.6 is allowed" in result.objects[0].refused
    np.testing.assert_array_equal(object_rows(result), truth)


def test_an_object_that_other_things_hide_is_seen_through_a_gap():
    scene, truth = ball_among_leaves(3.0)
    assert jaccard(object_rows(trim(scene, truth, config=small_config())), truth) > 0.9


def test_what_shines_through_leaves_is_not_lost():
    scene, truth = ball_among_leaves(0.0)
    bold = AcceptanceConfig(max_wrong=1.0)
    assert jaccard(object_rows(trim(scene, truth, config=small_config(acceptance=bold))), truth) > 0.98


def test_what_hides_nothing_changes_nothing():
    scene, truth = ball_on_floor()
    result = trim(scene, truth, config=small_config())
    assert max(view.view.hidden_share for view in result.objects[0].views) < 0.01


def test_wrong_masks_do_not_destroy_an_object_by_the_papers_rules():
    scene, truth = ball_on_floor()
    rng = np.random.default_rng(0)
    config = paper_config(small_config())
    result = toy.trim_by(lambda view: rng.random(view.alpha.shape) < 0.3, scene, truth, config=config)
    assert result.objects[0].refused is not None
    np.testing.assert_array_equal(object_rows(result), truth)
