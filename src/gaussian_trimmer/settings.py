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
        _check(getattr(settings, name), kind, f"{prefix}.{name}".lstrip(".").replace("_", "-"))


@cache
def hints_of(settings: type) -> dict[str, Any]:
    """The types of a dataclass's fields with their ranges, by name."""
    hints = get_type_hints(settings, include_extras=True)
    return {field.name: hints[field.name] for field in fields(settings)}


def _check(value: Any, kind: Any, name: str) -> None:
    """Check one value against the type of its field; types that are neither number nor choice allow everything."""
    origin, arguments = get_origin(kind), get_args(kind)
    if is_dataclass(kind):
        if not isinstance(value, kind):  # type: ignore[arg-type]
            raise _impossible(name, value, f"settings of the kind {getattr(kind, '__name__', kind)}")
        check_settings(value, name)
    elif origin is Annotated:
        allowed = next((note for note in arguments[1:] if isinstance(note, Range)), None)
        if allowed is None:
            _check(value, arguments[0], name)
        else:
            _check_number(value, arguments[0], allowed, name)
    elif origin in (Union, types.UnionType):
        if value is not None:
            _check(value, next(argument for argument in arguments if argument is not types.NoneType), name)
    elif origin is tuple:
        _check_tuple(value, arguments, name)
    elif origin is Literal and (not isinstance(value, str | int) or value not in arguments):
        raise InputError(f"{name} is {shown(repr(value))}; available: {', '.join(map(str, arguments))}.")
    elif kind is bool and not isinstance(value, bool):
        raise _impossible(name, value, "True or False")


def _check_number(value: Any, kind: type, allowed: Range, name: str) -> None:
    whole = kind is int
    if isinstance(value, bool) or not isinstance(value, Integral if whole else Real) or value not in allowed:
        number = "a whole number" if whole else "a number"
        raise _impossible(name, value, f"{number} from {allowed.low:.12g} to {allowed.high:.12g}")


def _check_tuple(value: Any, kinds: tuple[Any, ...], name: str) -> None:
    any_length = len(kinds) == 2 and kinds[1] is Ellipsis
    is_list = isinstance(value, Sequence | np.ndarray) and not isinstance(value, str)
    if not is_list or not (any_length or len(value) == len(kinds)):
        raise _impossible(name, value, "a list of values" if any_length else f"{len(kinds)} values")
    for i, element in enumerate(value):
        _check(element, kinds[0] if any_length else kinds[i], name)


def _impossible(name: str, value: Any, allowed: str) -> InputError:
    return InputError(
        f"{name} is {shown(str(value) if isinstance(value, Real) else repr(value))}; it must be {allowed}."
    )
