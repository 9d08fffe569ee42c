"""Dataclasses whose fields say what they may hold: checked, and as plain JSON and back.

    @dataclass(frozen=True)
    class EvidenceConfig:
        prior: Weight = 1.0
        looks: Annotated[int, Range(1, 100)] = 5

Settings from Python, from the command line and from files pass the same check, which says of the first value that is
not possible what it is and what it may be. Without a range a number would be checked by nobody, so every number of a
configuration has one; a test sees to that.
"""

from __future__ import annotations

import ast
import inspect
import textwrap
import types
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass, replace
from functools import cache
from itertools import pairwise
from numbers import Integral, Real
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from gaussian_trimmer.errors import InputError, clip_name


@dataclass(frozen=True)
class Range:
    """From the least to the largest value that a number may have, both included."""

    low: float
    high: float


_LARGEST: dict[Any, Range] = {int: Range(-(1 << 53), 1 << 53), float: Range(-1e30, 1e30)}
"""Where a field states no range: whole numbers that survive programs which keep all numbers as floats, and others whose
squares can still be computed with."""
Share = Annotated[float, Range(0, 1)]
"""A part of a whole."""
Component = Annotated[float, Range(-1e9, 1e9)]
Vector = tuple[Component, Component, Component]
"""A direction, of any length."""
Weight = Annotated[float, Range(0, 1000)]
"""How much something counts beside something else; 0: not at all."""
_MAX_PATH = 4096
_METAVARS = {int: "INT", float: "FLOAT", bool: "{true,false}"}
Settings = TypeVar("Settings")
Readers = Mapping[Any, Callable[[Any, str], Any]]
_NONE: Readers = types.MappingProxyType({})


def check_settings(settings: Any, prefix: str = "") -> None:
    """Refuse values that a field of a dataclass cannot have: out of range, not finite, or of another type.

    Args:
        settings: an instance of a dataclass; those in its fields are checked as well.
        prefix: what the command line writes before the names of its fields.

    Raises:
        InputError: a setting is not possible.

    >>> from gaussian_trimmer.trimming.evidence import EvidenceConfig
    >>> check_settings(EvidenceConfig(min_in_place=float("nan")), "evidence")
    Traceback (most recent call last):
    gaussian_trimmer.errors.InputError: evidence.min-in-place is nan; it must be a number from 0 to 1.
    """
    from_plain(settings, type(settings), prefix)


@cache
def hints_of(settings: type) -> dict[str, Any]:
    """Return the types of a dataclass's fields with their ranges, by name."""
    hints = get_type_hints(settings, include_extras=True)
    return {field.name: hints[field.name] for field in fields(settings)}


def to_plain(value: Any, writers: Mapping[type, Callable[[Any], Any]] = types.MappingProxyType({})) -> Any:
    """Return a dataclass, or a value of one of its fields, as JSON holds it.

    Args:
        value: dataclasses become objects; tuples and arrays become lists; paths become text.
        writers: what becomes of values of other types, or of these.

    >>> to_plain(Range(0, 1))
    {'low': 0, 'high': 1}
    """
    for kind, write in writers.items():
        if isinstance(value, kind):
            return write(value)
    if is_dataclass(value):
        return {field.name: to_plain(getattr(value, field.name), writers) for field in fields(value)}
    if isinstance(value, tuple | list):
        return [to_plain(entry, writers) for entry in value]
    if isinstance(value, dict):
        return {name: to_plain(entry, writers) for name, entry in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return str(value) if isinstance(value, Path) else value


def from_plain(data: Any, kind: Any, where: str, readers: Readers = _NONE) -> Any:
    """Return the value of a type that plain JSON stands for; the inverse of `to_plain`.

    Args:
        data: what `json.loads` returned, or the value itself, which is checked then.
        kind: a dataclass, or a type that its fields have: numbers (with a `Range`), text, paths, choices, tuples,
            dataclasses, one of these or None, or `Any`.
        where: what the message on a wrong value begins with: a name, or a file and ": ".
        readers: functions of a value and its place in the document, for types that are read in another way.

    Raises:
        InputError: a value is missing, unknown, or of the wrong type.

    >>> from_plain({"low": 0, "high": 1}, Range, "range")
    Range(low=0.0, high=1.0)
    >>> from_plain({"low": 0, "high": "one"}, Range, "range")
    Traceback (most recent call last):
    gaussian_trimmer.errors.InputError: range.high is 'one'; it must be a finite number.
    """
    origin, arguments = get_origin(kind), get_args(kind)
    if kind in readers:
        return readers[kind](data, where)
    if is_dataclass(kind):
        return _dataclass_from(data, kind, where, readers)
    if origin in (Union, types.UnionType):
        return None if data is None else from_plain(data, without_none(kind), where, readers)
    if origin is tuple:
        elements = enumerate(_elements(data, arguments, where))
        return tuple(from_plain(value, element, f"{where}[{i}]", readers) for i, (value, element) in elements)
    if origin is dict and isinstance(data, dict):
        return {name: from_plain(value, arguments[1], _joined(where, name), readers) for name, value in data.items()}
    if origin is dict:
        raise wrong_value(data, where, "an object")
    if origin is Annotated:
        allowed = next((note for note in arguments[1:] if isinstance(note, Range)), None)
        if allowed is None:
            return from_plain(data, arguments[0], where, readers)
        return _number(data, arguments[0], allowed, where)
    if origin is Literal and (not isinstance(data, str | int) or data not in arguments):
        raise InputError(f"{where} is {clip_name(repr(data))}; available: {', '.join(map(str, arguments))}.")
    if kind is bool and not isinstance(data, bool):
        raise wrong_value(data, where, "true or false")
    if kind in _LARGEST:
        return _number(data, kind, None, where)
    if kind is str and not isinstance(data, str):
        raise wrong_value(data, where, "text")
    return _path(data, where) if kind is Path else data


def without_none(kind: Any) -> Any:
    """Return the type that an optional one has beside None."""
    return next(argument for argument in get_args(kind) if argument is not types.NoneType)


def wrong_value(value: Any, name: str, needed: str) -> InputError:
    """Return the error that says what a value must be."""
    said = str(value) if isinstance(value, Real) else repr(value)
    return InputError(f"{name} is {clip_name(said)}; it must be {needed}.")


def _dataclass_from(data: Any, kind: Any, where: str, readers: Readers) -> Any:
    hints = hints_of(kind)
    if isinstance(data, kind):  # the command line spells names with dashes
        for name, hint in hints.items():
            from_plain(getattr(data, name), hint, _joined(where, name.replace("_", "-")), readers)
        return data
    if not isinstance(data, dict):
        raise wrong_value(data, where, f"an object with the fields of {kind.__name__}")
    if unknown := [name for name in data if name not in hints]:
        raise InputError(f"{where} has the unknown field '{clip_name(unknown[0])}'; available: {', '.join(hints)}.")
    for field in fields(kind):
        if field.name not in data and field.default is MISSING and field.default_factory is MISSING:
            raise InputError(f"{where} has no {field.name}.")
    return kind(**{name: from_plain(value, hints[name], _joined(where, name), readers) for name, value in data.items()})


def _joined(where: str, name: str) -> str:
    return f"{where}{'' if not where or where.endswith(': ') else '.'}{name}"


def _elements(value: Any, kinds: tuple[Any, ...], where: str) -> list[tuple[Any, Any]]:
    """Return the elements of a list or an array, each with its type in a tuple of these types."""
    any_length = len(kinds) == 2 and kinds[1] is Ellipsis
    is_list = isinstance(value, Sequence | np.ndarray) and not isinstance(value, str)
    if not is_list or not (any_length or len(value) == len(kinds)):
        raise wrong_value(value, where, "a list of values" if any_length else f"{len(kinds)} values")
    return [(element, kinds[0] if any_length else kinds[i]) for i, element in enumerate(value)]


def _number(value: Any, kind: type, allowed: Range | None, where: str) -> Any:
    ends = allowed or _LARGEST[kind]
    is_number = isinstance(value, Integral if kind is int else Real) and not isinstance(value, bool)
    if not is_number or not ends.low <= value <= ends.high:  # NaN neither
        limits = f" from {ends.low:.12g} to {ends.high:.12g}" if allowed else ""
        raise wrong_value(value, where, f"a {'whole ' if kind is int else '' if limits else 'finite '}number{limits}")
    return float(value) if kind is float else value


def _path(data: Any, where: str) -> Path:
    if not isinstance(data, str | Path) or not str(data) or "\0" in str(data) or len(str(data)) > _MAX_PATH:
        raise wrong_value(data, where, "a path" if isinstance(data, str) else "text")
    return Path(data)


def settings_in(kind: type, prefix: str = "") -> dict[str, tuple[type, str, Any]]:
    """Return a dataclass's settings by name, those of dataclasses within it with dots: owner, field and type of each.

    >>> from gaussian_trimmer.trimming.config import TrimConfig
    >>> settings_in(TrimConfig)["plan.views"][1]
    'views'
    """
    found = dict[str, tuple[type, str, Any]]()
    for name, hint in hints_of(kind).items():
        spelt = prefix + name.replace("_", "-")
        found |= settings_in(hint, f"{spelt}.") if is_dataclass(hint) else {spelt: (kind, name, hint)}  # type: ignore[arg-type]
    return found


def with_settings(base: Settings, given: Mapping[str, Any], group: str = "") -> Settings:
    """Return a dataclass with other values for some settings.

    Args:
        base: the dataclass.
        given: values by name, as `Parser.parse` returns them; names of other groups are left alone.
        group: the group of the dataclass.
    """
    for name, value in given.items():
        owner, _, own = name.rpartition(".") if group else ("", "", name)
        if owner == group and own.split(".")[0].replace("-", "_") in {field.name for field in fields(base)}:  # type: ignore[arg-type]
            base = _replaced(base, own.replace("-", "_").split("."), value)
    return base


def _replaced(base: Any, path: list[str], value: Any) -> Any:
    first, *rest = path
    return replace(base, **{first: _replaced(getattr(base, first), rest, value) if rest else value})


def from_words(words: list[str], kind: Any, where: str) -> Any:
    """Return the value of a kind that words stand for.

    Raises:
        InputError: it is not possible.
    """
    elements, kind = elements_of(kind), _given(kind)
    if elements is None:
        return from_plain(_plain(words[0], kind), kind, where)
    kinds = elements[:1] * len(words) if elements[-1] is Ellipsis else elements
    plain = [_plain(word, element) for word, element in zip(words, kinds, strict=False)]
    return from_plain(plain if len(words) == len(kinds) else words, kind, where)


def metavar_of(kind: Any) -> str:
    """Return what stands for a value in help."""
    if (elements := elements_of(kind)) is not None:
        return " ".join("..." if element is Ellipsis else metavar_of(element) for element in elements)
    kind = _bare(_given(kind))
    if get_origin(kind) is Literal:
        return "{" + ",".join(map(str, get_args(kind))) + "}"
    return _METAVARS.get(kind, "PATH" if kind is Path else "TEXT")


def docstrings(kind: type) -> dict[str, str]:
    """Return what stands below each field in the source of a dataclass."""
    (tree,) = ast.parse(textwrap.dedent(inspect.getsource(kind))).body
    assert isinstance(tree, ast.ClassDef)
    found = dict.fromkeys((field.name for field in fields(kind)), "")
    for field, below in pairwise(tree.body):
        match field, below:
            case ast.AnnAssign(target=ast.Name(name)), ast.Expr(value=ast.Constant(str(text))):
                found[name] = text
    return found


def _given(kind: Any) -> Any:
    """Return the type of what is given: an optional one without None."""
    return without_none(kind) if type(None) in get_args(kind) else kind


def _bare(kind: Any) -> Any:
    return get_args(kind)[0] if get_origin(kind) is Annotated else kind


def elements_of(kind: Any) -> tuple[Any, ...] | None:
    """Return the types of the values that a value consists of, the last may be an ellipsis; None if it is one."""
    given = _given(kind)
    return get_args(given) if get_origin(given) is tuple else None


def _plain(word: str, kind: Any) -> Any:
    """Return what a word stands for, as JSON would hold it; a word that is not of its type stays, and is refused."""
    kind = _bare(_given(kind))
    if get_origin(kind) is Literal:
        return next((choice for choice in get_args(kind) if str(choice) == word), word)
    if kind is bool:
        return {"true": True, "false": False}.get(word.lower(), word)
    if kind in (int, float):
        try:
            return kind(word)
        except ValueError:
            return word
    return word
