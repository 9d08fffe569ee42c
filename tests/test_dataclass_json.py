"""Dataclasses as JSON: what comes back is what was given, and wrong values are named by their place."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import pytest

from gaussian_trimmer.config import TrimConfig
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.io.dataclass_json import from_plain, to_plain
from gaussian_trimmer.settings import Range


@dataclass(frozen=True)
class Inner:
    place: tuple[float, float] = (0.0, 1.0)
    name: str | None = None


@dataclass(frozen=True)
class Outer:
    path: Path
    kind: Literal["a", "b"] = "a"
    share: Annotated[float, Range(0, 1)] = 0.5
    ids: tuple[int, ...] = ()
    quick: bool = False
    inner: Inner = field(default_factory=Inner)


@pytest.mark.parametrize(
    "given", [Outer(Path("x/y.npy")), Outer(Path("z"), "b", 1, (3, 7), True, Inner((2, 3), "n")), TrimConfig()]
)
def test_round_trip(given):
    plain = to_plain(given)
    assert from_plain(plain, type(given), "it") == given
    assert to_plain(from_plain(plain, type(given), "it")) == plain


def test_other_types_have_readers_and_writers():
    plain = to_plain(Outer(Path("x")), {Path: lambda path: path.name.upper()})
    assert plain["path"] == "X"
    assert from_plain(plain, Outer, "it", {Path: lambda data, where: Path(where) / data}).path == Path("it.path/X")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"path": None}, "it.path is None; it must be text"),
        ({"kind": "c"}, "it.kind is 'c'; available: a, b"),
        ({"share": 1.5}, "it.share is 1.5; it must be a number from 0 to 1"),
        ({"share": True}, "it.share is True; it must be a number from 0 to 1"),
        ({"ids": [1, 2.0]}, r"it.ids\[1\] is 2.0; it must be a whole number"),
        ({"quick": 1}, "it.quick is 1; it must be true or false"),
        ({"inner": {"place": [1]}}, r"it.inner.place is \[1\]; it must be 2 values"),
        ({"inner": []}, "an object with the fields of Inner"),
        ({"outer": 1}, "unknown field 'outer'"),
    ],
)
def test_wrong_values_are_named(changes, message):
    with pytest.raises(InputError, match=message):
        from_plain({"path": "x"} | changes, Outer, "it")
