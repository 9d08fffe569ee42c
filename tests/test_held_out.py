"""How a setting is chosen: a group of captures has no say in the value that it is measured with."""

import pytest
from held_out import changed, chosen, group_of, report

from gaussian_trimmer.config import TrimConfig
from gaussian_trimmer.errors import InputError

GROUPS = {
    "a": {"low": 90.0, "high": 99.0},  # alone for the high value, and by so much that all together choose it
    "b": {"low": 80.0, "high": 79.0},
    "c": {"low": 70.0, "high": 69.0},
}
VALUES = ["low", "high"]


def test_the_group_under_test_has_no_say():
    assert [chosen(GROUPS, VALUES, group) for group in GROUPS] == ["low", "high", "high"]
    assert chosen(GROUPS, VALUES) == "high"
    *rows, mean = report(GROUPS, VALUES)[1:]
    assert [row.split("  ")[-1] for row in rows] == ["low: 90.00", "high: 79.00", "high: 69.00"]
    assert "held out 79.33; all choose high" in mean


def test_one_group_cannot_be_left_out():
    with pytest.raises(InputError, match="one group"):
        report({"a": GROUPS["a"]}, VALUES)


def test_scenes_that_share_objects_are_one_group():
    assert group_of("sparse") == group_of("scene0_haze") != group_of("touching")
    assert group_of("flat") == group_of("parts")
    assert group_of("room_a_small") == group_of("room_a") != group_of("room_b")


def test_a_setting_is_named_as_on_the_command_line():
    assert changed(TrimConfig(), "evidence.min-in-place", 0.6).evidence.min_in_place == 0.6
    config = changed(TrimConfig(), "evidence.prior", 0.3)
    assert config.evidence.prior == 0.3
    assert changed(config, "evidence.prior", TrimConfig().evidence.prior) == TrimConfig()
    with pytest.raises(InputError, match="no setting 'evidnce'"):
        changed(config, "evidnce.prior", 0.3)
