"""Ranges of settings: stated beside each field of a dataclass, as part of its type, and checked in one place.

    @dataclass(frozen=True)
    class EvidenceConfig:
        prior: Weight = 1.0
        looks: Annotated[int, Range(1, 100)] = 5

`check_settings` goes through all fields, also those of dataclasses within, and says of the first that is not possible
what it is, as the command line spells it, and what it may be. Without a range a number would be checked by nobody, so
every number of a configuration has one; a test sees to that.
"""

from __future__ import annotations

import types
from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from numbers import Integral, Real
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np

from gaussian_trimmer.errors import InputError, shown


@dataclass(frozen=True)
class Range:
    """From the least to the largest value that a number may have, both included."""

    low: float
    high: float

    def __contains__(self, value: Any) -> bool:
        return bool(self.low <= value <= self.high)  # false for NaN


_LARGEST: dict[Any, Range] = {int: Range(-(1 << 53), 1 << 53), float: Range(-1e30, 1e30)}
"""Where a field states no range: whole numbers that survive programs which keep all numbers as floats, and others whose
squares can still be computed with."""
Share = Annotated[float, Range(0, 1)]
"""A part of a whole."""
_Component = Annotated[float, Range(-1e9, 1e9)]
Vector = tuple[_Component, _Component, _Component]
"""A direction, of any length."""
Weight = Annotated[float, Range(0, 1000)]
"""How much something counts beside something else; 0: not at all."""


def check_settings(settings: Any, prefix: str = "") -> None:
    """Refuse values that a field of a dataclass cannot have: out of range, not finite, or of another type.

    Args:
        settings: an instance of a dataclass; those in its fields are checked as well.
        prefix: what the command line writes before the names of its fields.

    Raises:
        InputError: a setting is not possible.

    >>> check_settings(Range(0, 1))
    >>> from gaussian_trimmer.decomposition.evidence import EvidenceConfig
    >>> check_settings(EvidenceConfig(recover_limit=float("nan")), "evidence")
    Traceback (most recent call last):
    gaussian_trimmer.errors.InputError: evidence.recover-limit is nan; it must be a number from 0 to 1.
    """
    for name, kind in hints_of(settings.__class__).items():
        check_value(getattr(settings, name), kind, f"{prefix}.{name}".lstrip(".").replace("_", "-"))


@cache
def hints_of(settings: type) -> dict[str, Any]:
    """The types of a dataclass's fields with their ranges, by name."""
    hints = get_type_hints(settings, include_extras=True)
    return {field.name: hints[field.name] for field in fields(settings)}


def check_value(value: Any, kind: Any, name: str) -> None:
    """Check a value against the type of its field; types that are neither number nor choice allow everything.

    Raises:
        InputError: the type does not have this value; the message calls it by the name.
    """
    origin, arguments = get_origin(kind), get_args(kind)
    if is_dataclass(kind):
        if not isinstance(value, kind):  # type: ignore[arg-type]
            raise wrong_value(value, name, f"settings of the kind {getattr(kind, '__name__', kind)}")
        check_settings(value, name)
    elif origin is Annotated:
        allowed = next((note for note in arguments[1:] if isinstance(note, Range)), None)
        if allowed is None:
            check_value(value, arguments[0], name)
        else:
            _check_number(value, arguments[0], allowed, name, f" from {allowed.low:.12g} to {allowed.high:.12g}")
    elif origin in (Union, types.UnionType):
        if value is not None:
            check_value(value, without_none(kind), name)
    elif origin is tuple:
        for element, element_kind in tuple_elements(value, kind, name):
            check_value(element, element_kind, name)
    elif origin is Literal and (not isinstance(value, str | int) or value not in arguments):
        raise InputError(f"{name} is {shown(repr(value))}; available: {', '.join(map(str, arguments))}.")
    elif kind is bool and not isinstance(value, bool):
        raise wrong_value(value, name, "true or false")
    elif kind in (int, float):
        _check_number(value, kind, _LARGEST[kind], name)


def without_none(kind: Any) -> Any:
    """The type that an optional one has beside None."""
    return next(argument for argument in get_args(kind) if argument is not types.NoneType)


def tuple_elements(value: Any, kind: Any, name: str) -> list[tuple[Any, Any]]:
    """The elements of a list or an array, each with the type that it has in a tuple of some type.

    Raises:
        InputError: the value is no list, or not of the tuple's length.
    """
    kinds = get_args(kind)
    any_length = len(kinds) == 2 and kinds[1] is Ellipsis
    is_list = isinstance(value, Sequence | np.ndarray) and not isinstance(value, str)
    if not is_list or not (any_length or len(value) == len(kinds)):
        raise wrong_value(value, name, "a list of values" if any_length else f"{len(kinds)} values")
    return [(element, kinds[0] if any_length else kinds[i]) for i, element in enumerate(value)]


def wrong_value(value: Any, name: str, needed: str) -> InputError:
    """The error that says what a value must be."""
    return InputError(
        f"{name} is {shown(str(value) if isinstance(value, Real) else repr(value))}; it must be {needed}."
    )


def _check_number(value: Any, kind: type, allowed: Range, name: str, limits: str = "") -> None:
    if isinstance(value, bool) or not isinstance(value, Integral if kind is int else Real) or value not in allowed:
        raise wrong_value(value, name, f"a {'whole ' if kind is int else '' if limits else 'finite '}number{limits}")
