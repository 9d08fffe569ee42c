"""Every setting has a range that is stated and finite, and what lies outside ends in one sentence before any work."""

import importlib
import math
import pkgutil
import re
import types
from dataclasses import dataclass, is_dataclass
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import numpy as np
import pytest
from command_line import run

import gaussian_trimmer
from gaussian_trimmer.config import TrimConfig, check_config, paper_config
from gaussian_trimmer.decomposition.split_rules import SPLIT_RULES
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.finding.judging import FindConfig
from gaussian_trimmer.segmentation.segmenters import get_segmenter
from gaussian_trimmer.segmentation.segmenters.grabcut import GrabCutConfig
from gaussian_trimmer.segmentation.segmenters.mask_files import MaskFilesConfig
from gaussian_trimmer.segmentation.segmenters.sam import SamConfig
from gaussian_trimmer.segmentation.segmenters.sam2_video import Sam2Config
from gaussian_trimmer.selecting.overview import OverviewConfig
from gaussian_trimmer.selection_files import SelectionOptions
from gaussian_trimmer.settings import Range, Vector, check_settings, hints_of

ROOTS = {
    TrimConfig: "", SelectionOptions: "selection",
    GrabCutConfig: "grabcut", Sam2Config: "sam2", SamConfig: "sam",
    MaskFilesConfig: "mask-files", OverviewConfig: "", FindConfig: "",
}  # fmt: skip
HARMLESS = {
    (Sam2Config, "model"), (SamConfig, "model"), (Sam2Config, "device"), (MaskFilesConfig, "folder"),
    (SelectionOptions, "property"), (SelectionOptions, "classifier"),
}  # fmt: skip
"""Names of files, folders and the like, which those who open them check."""


def numbers_of(kind):
    """The ranges of the numbers within a type; None for a number that has none."""
    if kind in (int, float):
        return [None]
    if get_origin(kind) is Annotated:
        ranges = [note for note in kind.__metadata__ if isinstance(note, Range)]
        return ranges or numbers_of(get_args(kind)[0])
    if get_origin(kind) is Literal:
        return []
    return [found for argument in get_args(kind) for found in numbers_of(argument)]


def is_whole(kind):
    """Whether the numbers within a type are whole ones."""
    return kind is int or any(is_whole(argument) for argument in get_args(kind))


def plain(kind):
    """The type without None and without notes."""
    if get_origin(kind) is Annotated:
        return plain(get_args(kind)[0])
    if get_origin(kind) in (Union, types.UnionType):
        (kind,) = (argument for argument in get_args(kind) if argument is not type(None))
        return plain(kind)
    return kind


def settings_below(root, prefix=""):
    """Dataclass, field's name, type, and name on the command line, of all settings that are no dataclasses."""
    for name, kind in hints_of(root).items():
        spelt = f"{prefix}.{name}".lstrip(".").replace("_", "-")
        if is_dataclass(kind):
            yield from settings_below(kind, spelt)
        else:
            yield root, name, kind, spelt


ALL = [setting for root, prefix in ROOTS.items() for setting in settings_below(root, prefix)]
NUMBERS = [setting for setting in ALL if numbers_of(setting[2])]


def spelt(setting):
    return setting[-1]


def replaced(setting, value):
    """Settings in which one has a value, and what their root's prefix is."""
    owner, name, _, _ = setting
    return owner(**{name: value}), setting[-1].rpartition(".")[0]


def test_every_dataclass_of_settings_is_checked():
    names = [module.name for module in pkgutil.walk_packages(gaussian_trimmer.__path__, "gaussian_trimmer.")]
    modules = [importlib.import_module(name) for name in names if not name.endswith("__main__")]
    found = [value for module in modules for value in vars(module).values() if isinstance(value, type)]
    kinds = {kind for kind in found if is_dataclass(kind) and kind.__name__.endswith(("Config", "Options"))}
    # The options of commands are groups of arguments, and each command has tests of its own; tyro makes another.
    groups = tuple(f"gaussian_trimmer.{room}." for room in ("commands", "batch", "evaluation", "trimming"))
    kinds = {kind for kind in kinds if kind.__module__.startswith("gaussian_trimmer.")}
    kinds = {kind for kind in kinds if not kind.__module__.startswith(groups) or kind.__name__.endswith("Config")}
    assert {setting[0] for setting in ALL} | {TrimConfig} == kinds


@pytest.mark.parametrize("setting", ALL, ids=spelt)
def test_every_setting_has_finite_ranges_or_needs_none(setting):
    owner, name, kind, _ = setting
    ranges = numbers_of(kind)
    assert None not in ranges, "a number without a range"
    for allowed in ranges:
        assert math.isfinite(allowed.low) and math.isfinite(allowed.high) and allowed.low < allowed.high
    if not ranges:
        assert plain(kind) is bool or get_origin(plain(kind)) is Literal or (owner, name) in HARMLESS


def test_defaults_and_presets_are_possible():
    for root, prefix in ROOTS.items():
        check_settings(root(), prefix)
    check_config(paper_config())


@pytest.mark.parametrize("setting", NUMBERS, ids=spelt)
def test_numbers_outside_are_refused(setting):
    _, _, kind, said = setting
    allowed = numbers_of(kind)[0]
    whole, length = is_whole(kind), allowed.high - allowed.low
    wrong = [math.nan, math.inf, -math.inf, allowed.low - length, allowed.high + length, 10**400]
    wrong += [True, "1", "x", np.float32(np.nan), np.float64(1e300), *([allowed.low + 0.5] if whole else [])]
    for value in wrong:
        settings, prefix = replaced(setting, shaped(kind, value))
        with pytest.raises(InputError) as caught:
            check_settings(settings, prefix)
        message = str(caught.value)
        assert message.startswith(f"{said} is ") and message.endswith(".") and len(message) < 200
        assert f"it must be a {'whole ' if whole else ''}number from {allowed.low:.12g} to" in message


@pytest.mark.parametrize("setting", NUMBERS, ids=spelt)
def test_the_ends_of_a_range_are_possible(setting):
    _, _, kind, _ = setting
    allowed = numbers_of(kind)[0]
    number = np.int64 if is_whole(kind) else np.float32
    for value in (allowed.low, allowed.high):
        check_settings(*replaced(setting, shaped(kind, value)))
    check_settings(*replaced(setting, shaped(kind, number(math.ceil(allowed.low)))))


def shaped(kind, value):
    """A value as a setting of a type takes it: alone, or as often as its tuple is long."""
    if get_origin(plain(kind)) is not tuple:
        return value
    return (value,) * len([argument for argument in get_args(plain(kind)) if argument is not Ellipsis])


@dataclass(frozen=True)
class Inner:
    share: Annotated[float, Range(0, 1)] = 0.5


@dataclass(frozen=True)
class Outer:
    inner_part: Inner = Inner()
    choice: Literal["one", "two"] = "one"
    on: bool = True
    up: Vector | None = None
    ids: tuple[Annotated[int, Range(0, 9)], ...] = ()
    free: Any = None


def outer(**values):
    return Outer(**values)


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        (outer(inner_part=Inner(2)), "a.inner-part.share is 2; it must be a number from 0 to 1."),
        (outer(inner_part=3), "a.inner-part is 3"),
        (outer(choice="three"), "a.choice is 'three'; available: one, two."),
        (outer(choice=None), "a.choice is None"),
        (outer(choice=np.zeros(2)), "a.choice is array"),
        (outer(on=1), "a.on is 1; it must be true or false."),
        (outer(up=(0, 1)), "a.up is (0, 1); it must be 3 values."),
        (outer(up="0 0 1"), "a.up is '0 0 1'"),
        (outer(up=(0, 0, None)), "a.up is None"),
        (outer(ids=(1, 12)), "a.ids is 12"),
        (outer(ids=4), "a.ids is 4"),
    ],
)
def test_the_setting_that_is_not_possible_is_named(settings, said):
    with pytest.raises(InputError, match=re.escape(said)):
        check_settings(settings, "a")


def test_what_is_possible_passes():
    check_settings(outer(up=np.array([0.0, 0, 1]), ids=[1, np.int32(9)], free=object(), choice="two", on=False))
    check_settings(outer(up=[0, 0, 1.0]))


def test_the_rules_of_splitting_are_those_that_exist():
    assert get_args(hints_of(type(TrimConfig().split))["rule"]) == (*SPLIT_RULES, "none")


@pytest.mark.parametrize(
    "options",
    [
        ["--label-crf.trust", "nan"],
        ["--boundary.min-area", "-1"],
        ["--label-crf.iterations", str(2**62)],
        ["--label-crf.support-plane.gap", "0"],
        ["--plan.yaw-range-degrees", "0", "inf"],
        ["--grabcut.iterations", "0"],
        ["--selection.query-row", "-1"],
        ["--preset", "paper", "--boundary.band", "0"],
    ],
)
def test_the_command_line_refuses_them_at_once(options, tmp_path, capsys):
    assert run("trim", tmp_path / "nowhere.ply", *options, "--output", tmp_path / "out") == 2
    printed = capsys.readouterr().err
    assert f"{options[-2 - ('inf' in options)][2:]} is " in printed
    assert printed.count("\n") == 1, "Nothing was read: there is no scene."
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("option", "value"), [("gamma", "nan"), ("gamma", "-2"), ("up", "inf")])
def test_select_refuses_them_at_once(option, value, tmp_path, capsys):
    values = [value] * (3 if option == "up" else 1)
    assert run("select", tmp_path / "nowhere.ply", "--click", 1, 1, f"--{option}", *values) == 2
    assert f"{option} is {float(value)}; it must be a number from" in capsys.readouterr().err


def test_segmenters_check_their_own():
    with pytest.raises(InputError, match=r"grabcut\.outer is -1; it must be a number from 0 to 1"):
        get_segmenter("grabcut", GrabCutConfig(outer=-1))
