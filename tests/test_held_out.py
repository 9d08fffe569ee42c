"""How settings are chosen: a group of captures has no say in the values that it is measured with."""

import pytest
from held_out import (
    DEFAULT,
    changed,
    choice_of,
    chosen,
    chosen_config,
    comparison,
    report,
    scores_by_group,
    variants_of,
)

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.trials import Run
from gaussian_trimmer.trimming.config import TrimConfig

LOW, HIGH = DEFAULT, "evidence.prior=2"
GROUPS = {
    "a": {LOW: 90.0, HIGH: 99.0},  # alone for the high value, and by so much that all together choose it
    "b": {LOW: 80.0, HIGH: 79.0},
    "c": {LOW: 70.0, HIGH: 69.0},
}
CHOICES = {"evidence.prior": (1.0, 2.0)}


def test_the_group_under_test_has_no_say():
    assert [chosen(GROUPS, [LOW, HIGH], group) for group in GROUPS] == [LOW, HIGH, HIGH]
    assert chosen(GROUPS, [LOW, HIGH]) == HIGH
    *rows, mean = report(GROUPS, [LOW, HIGH])[1:]
    assert [row.split("  ")[-1] for row in rows] == [f"{LOW}: 90.00", f"{HIGH}: 79.00", f"{HIGH}: 69.00"]
    assert f"held out 79.33; all choose {HIGH}" in mean
    assert [chosen_config(GROUPS, CHOICES, group).evidence.prior for group in GROUPS] == [1.0, 2.0, 2.0]


def test_one_group_cannot_be_left_out():
    with pytest.raises(InputError, match="one group"):
        report({"a": GROUPS["a"]}, [LOW, HIGH])


def run(scene, variant, before, after):
    scores = [{"iou": iou, "iou_in_scene": iou} for iou in (before, after)]
    return Run(scene, "cup", "exact", variant, 1, *scores, 0.0, "")


def test_scenes_that_share_objects_are_one_group():
    runs = [run(scene, DEFAULT, 80, 90) for scene in ("sparse", "scene0_8k", "touching")]
    assert scores_by_group(runs) == {"scene0": {DEFAULT: 90}, "touching": {DEFAULT: 90}}


def test_the_last_table_has_both_scores_and_what_is_lost():
    runs = [run("touching", DEFAULT, 80, 90), run("touching", "held out", 80, 79)]
    lines = comparison(runs)
    assert [line.split()[:1] for line in lines[1:]] == [["touching"], ["all"]]
    assert lines[1].split()[1:5] == ["1", "80.00", "90.00", "79.00"]
    assert "lose 0, 1" in lines[1]


def test_a_setting_is_named_as_on_the_command_line():
    assert changed(TrimConfig(), "evidence.min-in-place", 0.6).evidence.min_in_place == 0.6
    steps = changed(TrimConfig(), "refinement.steps", 8.0).refinement.steps
    assert (steps, type(steps)) == (8, int)
    config = changed(TrimConfig(), "evidence.prior", 0.3)
    assert config.evidence.prior == 0.3
    assert changed(config, "evidence.prior", TrimConfig().evidence.prior) == TrimConfig()
    with pytest.raises(InputError, match="no setting 'evidnce'"):
        changed(config, "evidnce.prior", 0.3)


def test_a_choice_is_a_name_and_values():
    assert dict([choice_of("evidence.prior=1,2")]) == CHOICES
    assert list(variants_of("evidence.prior", (1.0, 2.0))) == [HIGH]  # the default is there already
    with pytest.raises(InputError, match=r"'evidence\.prior' is no choice"):
        choice_of("evidence.prior")
