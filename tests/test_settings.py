"""Every number of a configuration has a range; what lies outside is one sentence that names it; JSON goes both ways."""

import importlib
import math
import pkgutil
from dataclasses import dataclass, field, is_dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin

import numpy as np
import pytest
from command_line import run

import gaussian_trimmer
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.settings import Range, Vector, check_settings, from_plain, hints_of, to_plain
from gaussian_trimmer.trimming.config import TrimConfig, paper_config


def numbers_of(kind):
    """The ranges of the numbers within a type; None for a number that has none."""
    if kind in (int, float):
        return [None]
    if get_origin(kind) is Literal:
        return []
    if ranges := [note for note in getattr(kind, "__metadata__", ()) if isinstance(note, Range)]:
        return ranges
    return [found for argument in get_args(kind) for found in numbers_of(argument)]


def configurations():
    """Every dataclass of settings in the package."""
    names = [module.name for module in pkgutil.walk_packages(gaussian_trimmer.__path__, "gaussian_trimmer.")]
    modules = [importlib.import_module(name) for name in names if not name.endswith("__main__")]
    found = [value for module in modules for value in vars(module).values() if isinstance(value, type)]
    return {kind for kind in found if is_dataclass(kind) and kind.__name__.endswith("Config")}


def test_every_number_of_a_configuration_has_a_finite_range():
    kinds = configurations()
    assert TrimConfig in kinds and len(kinds) > 10
    for kind in kinds:
        check_settings(kind())
        for name, hint in hints_of(kind).items():
            for allowed in numbers_of(hint):
                assert allowed is not None, f"{kind.__name__}.{name} has a number without a range"
                assert math.isfinite(allowed.low) and math.isfinite(allowed.high) and allowed.low < allowed.high
    check_settings(paper_config())


@dataclass(frozen=True)
class Inner:
    share: Annotated[float, Range(0, 1)] = 0.5
    name: str | None = None


@dataclass(frozen=True)
class Outer:
    path: Path = Path("x/y.npy")
    inner_part: Inner = field(default_factory=Inner)
    choice: Literal["one", "two"] = "one"
    on: bool = True
    up: Vector | None = None
    ids: tuple[Annotated[int, Range(0, 9)], ...] = ()
    free: Any = None


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"inner_part": Inner(2)}, "a.inner-part.share is 2; it must be a number from 0 to 1."),
        *(
            ({"inner_part": Inner(value)}, "a.inner-part.share is ")
            for value in (math.nan, math.inf, -1, 10**400, True, "1", np.float32(np.nan))
        ),
        ({"inner_part": 3}, "a.inner-part is 3"),
        ({"choice": "three"}, "a.choice is 'three'; available: one, two."),
        ({"choice": np.zeros(2)}, "a.choice is array"),
        ({"on": 1}, "a.on is 1; it must be true or false."),
        ({"up": (0, 1)}, "a.up is (0, 1); it must be 3 values."),
        ({"up": "0 0 1"}, "a.up is '0 0 1'"),
        ({"up": (0, 0, None)}, "a.up[2] is None"),
        ({"ids": (1, 12)}, "a.ids[1] is 12; it must be a whole number from 0 to 9."),
        ({"ids": (1, 2.5)}, "a.ids[1] is 2.5"),
        ({"ids": 4}, "a.ids is 4"),
    ],
)
def test_the_setting_that_is_not_possible_is_named(values, said):
    with pytest.raises(InputError) as caught:
        check_settings(Outer(**values), "a")
    assert str(caught.value).startswith(said) and len(str(caught.value)) < 200


def test_settings_by_the_names_of_options():
    config = TrimConfig.of({"--plan.size": 96, "label-crf.enabled": False, "refine": "off", "up": "-y"})
    assert (config.plan.size, config.label_crf.enabled, config.refine) == (96, False, "off")
    assert config.up == (0, -1, 0) and config.plan.views == TrimConfig().plan.views
    for wrong, named in (({"plan.size": 0}, "plan.size"), ({"plan.sizes": 96}, "sizes"), ({"up": "north"}, "north")):
        with pytest.raises(InputError, match=named):
            TrimConfig.of(wrong)


@pytest.mark.parametrize(
    "given", [Outer(), Outer(Path("z"), Inner(1, "n"), "two", False, (0, 0, 1), (3, 7)), TrimConfig(), paper_config()]
)
def test_what_is_written_as_json_is_read_again(given):
    plain = to_plain(given)
    assert from_plain(plain, type(given), "it") == given
    assert to_plain(from_plain(plain, type(given), "it")) == plain


def test_other_types_have_readers_and_writers():
    plain = to_plain(Outer(), {Path: lambda path: path.name.upper()})
    assert plain["path"] == "Y.NPY"
    assert from_plain(plain, Outer, "it", {Path: lambda data, where: Path(where) / data}).path == Path("it.path/Y.NPY")


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"path": None}, "it.path is None"),
        ({"inner_part": {"share": True}}, "it.inner_part.share is True"),
        ({"inner_part": {"name": 7}}, "it.inner_part.name is 7"),
        ({"inner_part": []}, "it.inner_part is []"),
        ({"outer": 1}, "it has the unknown field 'outer'"),
    ],
)
def test_wrong_json_is_named_by_its_place(values, said):
    with pytest.raises(InputError) as caught:
        from_plain(values, Outer, "it")
    assert str(caught.value).startswith(said)


@pytest.mark.parametrize(
    "options",
    [
        ["--set", "label-crf.trust=nan"],
        ["--set", "boundary.band=0"],
        ["--set", "plan.yaw-range-degrees=0,inf"],
        ["--set", "selection.query-row=-1"],
        ["--preset", "paper", "--set", "boundary.band=0"],
    ],
)
def test_the_command_line_refuses_them_at_once(options, tmp_path, capsys):
    assert run("trim", tmp_path / "nowhere.ply", *options, "--output", tmp_path / "out") == 2
    printed = capsys.readouterr().err
    assert options[-1].partition("=")[0] in printed
    assert printed.count("\n") == 1 and "it must be" in printed
    assert not (tmp_path / "out").exists()
