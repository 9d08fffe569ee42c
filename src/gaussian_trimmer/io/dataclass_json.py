"""Dataclasses as plain JSON, and back with their types checked."""

from __future__ import annotations

import types
from collections.abc import Callable, Mapping
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Any, Union, get_args, get_origin

import numpy as np

from gaussian_trimmer.errors import InputError, shown
from gaussian_trimmer.settings import check_value, hints_of, tuple_elements, without_none, wrong_value

_MAX_PATH = 4096
Readers = Mapping[Any, Callable[[Any, str], Any]]


def to_plain(value: Any, writers: Mapping[type, Callable[[Any], Any]] = types.MappingProxyType({})) -> Any:
    """A dataclass, or a value of one of its fields, as JSON holds it.

    Args:
        value: dataclasses become objects; tuples and arrays become lists; paths become text.
        writers: what becomes of values of other types, or of these.

    >>> from gaussian_trimmer.settings import Range
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

    >>> from gaussian_trimmer.settings import Range
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
        optional = types.NoneType in arguments
        return None if data is None and optional else from_plain(data, without_none(kind), where, readers)
    if origin is tuple:
        if not isinstance(data, list):
            raise wrong_value(data, where, "a list")
        listed = enumerate(tuple_elements(data, kind, where))
        return tuple(from_plain(value, element, f"{where}[{i}]", readers) for i, (value, element) in listed)
    if kind in (str, Path) and not isinstance(data, str):
        raise wrong_value(data, where, "text")
    if kind is Path:
        if not data or "\0" in data or len(data) > _MAX_PATH:
            raise wrong_value(data, where, "a path")
        return Path(data)
    check_value(data, kind, where)
    return float(data) if float in (kind, *arguments[:1]) else data


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
