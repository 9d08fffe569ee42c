"""Dataclasses as plain JSON, and back with their types checked."""

from __future__ import annotations

import types
from collections.abc import Callable, Mapping
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import numpy as np

from gaussian_trimmer.errors import InputError, shown
from gaussian_trimmer.settings import Range, hints_of

_LARGEST_WHOLE = 1 << 53
"""Whole numbers up to this survive programs that keep all numbers as floats."""
_LARGEST_NUMBER = 1e30
"""Greatest magnitude of other numbers, whose square can still be computed with."""
_MAX_PATH = 4096
Readers = Mapping[Any, Callable[[Any, str], Any]]


def to_plain(value: Any, writers: Mapping[type, Callable[[Any], Any]] = types.MappingProxyType({})) -> Any:
    """A dataclass, or a value of one of its fields, as JSON holds it.

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


def from_plain(data: Any, kind: Any, where: str, readers: Readers = types.MappingProxyType({})) -> Any:
    """The value of a type that plain JSON stands for; the inverse of `to_plain`.

    Args:
        data: what `json.loads` returned.
        kind: a dataclass, or a type that its fields have: numbers (with a `Range`), text, paths, choices, tuples,
            dataclasses, or one of these or None.
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
    if origin is Annotated:
        value = from_plain(data, arguments[0], where, readers)
        for allowed in arguments[1:]:
            if isinstance(allowed, Range) and value not in allowed:
                raise wrong_value(data, where, f"a number from {allowed.low:.12g} to {allowed.high:.12g}")
        return value
    if origin in (Union, types.UnionType):
        meant = [argument for argument in arguments if argument is not types.NoneType]
        return None if data is None and len(meant) < len(arguments) else from_plain(data, meant[0], where, readers)
    if origin is Literal:
        if not isinstance(data, str) or data not in arguments:
            raise wrong_value(data, where, f"one of {', '.join(arguments)}")
        return data
    if origin is tuple:
        return _tuple_from(data, arguments, where, readers)
    return data if kind is Any else _scalar_from(data, kind, where)


def wrong_value(data: Any, where: str, needed: str) -> InputError:
    """The error that says what a value must be."""
    return InputError(f"{where} is {shown(repr(data))}; it must be {needed}.")


def _dataclass_from(data: Any, kind: Any, where: str, readers: Readers) -> Any:
    if not isinstance(data, dict):
        raise wrong_value(data, where, f"an object with the fields of {kind.__name__}")
    hints = hints_of(kind)
    if unknown := [name for name in data if name not in hints]:
        raise InputError(f"{where} has the unknown field '{shown(unknown[0])}'; available: {', '.join(hints)}.")
    for field in fields(kind):
        if field.name not in data and field.default is MISSING and field.default_factory is MISSING:
            raise InputError(f"{where} has no {field.name}.")
    prefix = where if where.endswith(": ") else f"{where}."
    return kind(**{name: from_plain(value, hints[name], f"{prefix}{name}", readers) for name, value in data.items()})


def _tuple_from(data: Any, kinds: tuple[Any, ...], where: str, readers: Readers) -> tuple[Any, ...]:
    any_length = len(kinds) == 2 and kinds[1] is Ellipsis
    if not isinstance(data, list) or not (any_length or len(data) == len(kinds)):
        raise wrong_value(data, where, "a list" if any_length else f"a list of {len(kinds)} values")
    listed = (kinds[0] if any_length else kinds[i] for i in range(len(data)))
    return tuple(
        from_plain(value, kind, f"{where}[{i}]", readers)
        for i, (value, kind) in enumerate(zip(data, listed, strict=True))
    )


def _scalar_from(data: Any, kind: type, where: str) -> Any:
    """A truth value, a number, a text or a path."""
    if kind is bool and not isinstance(data, bool):
        raise wrong_value(data, where, "true or false")
    if kind is int and (isinstance(data, bool) or not isinstance(data, int) or abs(data) > _LARGEST_WHOLE):
        raise wrong_value(data, where, "a whole number")
    if kind is float:
        if isinstance(data, bool) or not isinstance(data, int | float) or not abs(data) <= _LARGEST_NUMBER:
            raise wrong_value(data, where, "a finite number")
        return float(data)
    if kind in (str, Path) and not isinstance(data, str):
        raise wrong_value(data, where, "text")
    if kind is Path:
        if not data or "\0" in data or len(data) > _MAX_PATH:
            raise wrong_value(data, where, "a path")
        return Path(data)
    return data
