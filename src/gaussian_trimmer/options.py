"""Dataclasses as options of the command line: each field is one, and so is each field of the dataclasses within.

    @dataclass(frozen=True)
    class Convert:
        source: Annotated[Positional[Path], arg(metavar="SOURCE")]
        sort: bool = False

is made by `parse(Convert, ["a.ply", "--sort"], "convert")`. Marks are the reason for a parser of our own: they take
effect in the order in which they are given, whatever their options are called, and an up vector is three numbers or an
axis. The options in a manifest of a batch are read in the same way.
"""

from __future__ import annotations

import re
import types
from collections import deque
from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass, replace
from functools import cache, cached_property
from typing import Annotated, Any, Literal, NoReturn, TypeVar, Union, cast, get_args, get_origin

from gaussian_trimmer.cameras import AXIS, vector_of_up
from gaussian_trimmer.errors import InputError, clip_name, did_you_mean
from gaussian_trimmer.settings import Range, from_plain, hints_of, without_none

Made = TypeVar("Made")
Names = tuple[str, ...]
"""Names of the fields that lead from a command to a value."""
UP = "X Y Z, or an axis such as z or -y"
_FLAG = re.compile(r"--[^\s=]*(=.*)?", re.DOTALL)
"""Unlike a negative number, this is not the next value of an option before it."""
_NEGATIVE_NUMBER = re.compile(r"-[\d.]")
_METAVARS = {int: "INT", float: "FLOAT", bool: "{true,false}"}


@dataclass(frozen=True)
class arg:  # noqa: N801 - it stands in annotations, where a note reads like one
    """What the type of a field does not say of its option."""

    metavar: str = ""
    """What stands for the value in help."""
    name: str | None = None
    """What it is called, if not like the field; "" leaves a dataclass's name out of those of its options."""
    default: str = ""
    """The default, where it depends on other options."""
    positional: bool = False
    """It has no flag."""
    ordered: bool = False
    """It may be given several times; the field has a tuple of all values."""
    order: bool = False
    """It has no flag: its field has names and values of all ordered options, in the order given."""
    of_options: bool = False
    """Its value is a text of options, so that the next word is that, also if it begins with dashes."""


_Value = TypeVar("_Value")
Positional = Annotated[_Value, arg(positional=True)]
Ordered = Annotated[tuple[_Value, ...], arg(ordered=True)]


@dataclass(frozen=True)
class Option:
    """One option or positional argument."""

    owner: type
    """The dataclass that has the field."""
    path: Names
    name: str
    """What it is called, without the dashes."""
    type: Any
    default: Any
    """`MISSING` if the option must be given."""

    @cached_property
    def note(self) -> arg:
        """What is noted beside its type."""
        return _note_on(self.type)

    @cached_property
    def kind(self) -> Any:
        """The type of one value, without None and without notes but its range."""
        kind = _without_notes(self.type)
        return get_args(kind)[0] if self.note.ordered else kind

    @property
    def elements(self) -> tuple[Any, ...]:
        """The types of the numbers or texts that its value consists of; the last may be an ellipsis."""
        return get_args(self.kind) if get_origin(self.kind) is tuple else (self.kind,)

    @property
    def metavar(self) -> str:
        """What stands for the value in help."""
        if self.name == "up":
            return UP
        return self.note.metavar or " ".join("..." if kind is Ellipsis else _metavar(kind) for kind in self.elements)

    @property
    def choices(self) -> tuple[str, ...]:
        """What its value may be, where that can be listed."""
        listed = re.fullmatch(r"\{(.+)\}", self.metavar)
        return tuple(listed[1].split(",")) if listed else ()

    @property
    def flags(self) -> Names:
        """How it is spelt; the second spelling means False."""
        if self.kind is not bool:
            return (f"--{self.name}",)
        group, dot, last = self.name.rpartition(".")
        return f"--{self.name}", f"--{group}{dot}no-{last}"

    @property
    def spelling(self) -> str:
        """What messages call it."""
        return self.metavar if self.note.positional else self.flags[0]


def parse(kind: type[Made], words: Sequence[str], command: str) -> Made:
    """Return a command, or a part of one, from what was typed after its name.

    A dataclass may have a class method `presets`, which gets the values given for its fields and returns others by the
    names of their fields. These take the place of defaults: what is given beside them counts.

    Args:
        kind: a dataclass.
        words: the words that were typed.
        command: what messages call it.

    Raises:
        InputError: an argument is missing, unknown or not possible.
    """
    given = _values(kind, words, command)
    options = options_of(cast(Hashable, kind))
    for owner, place in {(option.owner, option.path[:-1]): None for option in options}:
        if hasattr(owner, "presets"):
            mine = {path[len(place) :]: value for path, value in given.items() if path[: len(place)] == place}
            given = {(*place, *path): value for path, value in owner.presets(mine).items()} | given
    for option in options:
        if option.default is MISSING and option.path not in given:
            raise InputError(f"'{command}' needs {option.spelling}; see gaussian-trimmer {command} --help.")
    return cast(Made, _filled(kind, None, given))


@cache
def options_of(kind: type) -> tuple[Option, ...]:
    """Return all options of a dataclass, in the order of its fields."""
    return tuple(_options_in(kind, (), ""))


def _options_in(kind: type, path: Names, prefix: str) -> Iterator[Option]:
    for field in fields(kind):
        hint, default = hints_of(kind)[field.name], _default_of(field)
        own = _note_on(hint).name
        name = ".".join(filter(None, (prefix, (field.name if own is None else own).replace("_", "-"))))
        if (inner := _dataclass_in(hint, default)) is not None:
            yield from _options_in(inner, (*path, field.name), name)
        else:
            yield Option(kind, (*path, field.name), name, hint, default)


def _without_notes(kind: Any) -> Any:
    if get_origin(kind) in (Union, types.UnionType):
        return _without_notes(without_none(kind))
    if get_origin(kind) is Annotated and not any(isinstance(note, Range) for note in kind.__metadata__):
        return _without_notes(get_args(kind)[0])
    return kind


def _note_on(kind: Any) -> arg:
    """Return what all notes on a type say together."""
    said = [note for note in getattr(kind, "__metadata__", ()) if isinstance(note, arg)]
    return arg(**{name: value for note in said for name, value in vars(note).items() if value != getattr(arg, name)})


def _dataclass_in(hint: Any, default: Any) -> Any:
    """Return the dataclass whose fields are options in place of a field, by its default or its type."""
    kind = get_args(hint)[0] if get_origin(hint) is Annotated else hint
    return type(default) if is_dataclass(default) else kind if is_dataclass(kind) and default is MISSING else None


def _default_of(field: Field[Any]) -> Any:
    return field.default if field.default_factory is MISSING else field.default_factory()


def _filled(kind: Any, base: Any, given: Mapping[Names, Any]) -> Any:
    """Return a dataclass with values for its fields, or for those of dataclasses within; the base has the others."""
    values = {}
    for field in fields(kind):
        mine = {path[1:]: value for path, value in given.items() if path[0] == field.name}
        if not mine:
            continue
        default = _default_of(field) if base is None else getattr(base, field.name)
        value = mine.pop((), default)
        if mine:
            inner = _dataclass_in(hints_of(kind)[field.name], value)
            value = _filled(inner, None if value is MISSING else value, mine)
        values[field.name] = value
    return kind(**values) if base is None else replace(base, **values)


@cache
def flags_of(kind: type) -> dict[str, tuple[Option, bool]]:
    """Return all flags, with the option that they set and, of those without a value, what they set it to."""
    named = [option for option in options_of(kind) if not (option.note.positional or option.note.order)]
    return {flag: (option, number == 0) for option in named for number, flag in enumerate(option.flags)}


def _values(kind: type, words: Sequence[str], command: str) -> dict[Names, Any]:
    """Return the values that are given, by the paths of their options."""
    given: dict[Names, Any] = {}
    ordered: list[tuple[str, Any]] = []
    places = deque(option for option in options_of(kind) if option.note.positional)
    left = deque(words)
    while left:
        word = left[0]
        if word.startswith("--") or (word.startswith("-") and not _NEGATIVE_NUMBER.match(word)):
            left.popleft()
            flag, equals, value = word.partition("=")
            option, is_on = flags_of(kind).get(flag.replace("_", "-"), (None, False))
        else:
            option, is_on, equals, value = places.popleft() if places else None, False, "", ""
        if option is None:
            _refuse_unknown(word, kind, command)
        if option.kind is bool and not equals:
            given[option.path] = is_on
            continue
        attached = bool(equals) or option.note.of_options
        found = _value(option, deque([value]) if equals else left, attached)
        if option.note.ordered:
            ordered.append((option.path[-1], found))
            found = (*given.get(option.path, ()), found)
        given[option.path] = found
    given.update({option.path: tuple(ordered) for option in options_of(kind) if option.note.order})
    return given


def _value(option: Option, left: deque[str], attached: bool) -> Any:
    """Return the value that the next words are, which are taken out; what is attached may look like an option."""
    elements = option.elements
    count = len(left) if elements[-1] is Ellipsis else len(elements)
    words: list[str] = []
    while left and len(words) < count and (attached or not _FLAG.fullmatch(left[0])):
        word = left.popleft()
        if option.name == "up" and not words and AXIS.fullmatch(word):
            return vector_of_up(word)
        words += filter(None, re.split("[,/]", word)) if elements[-1] is not Ellipsis and len(elements) > 1 else [word]
    if not words or (len(words) != count and elements[-1] is not Ellipsis):
        said = f"is '{clip_name(' '.join(words))}'" if words else "has no value"
        wanted = f"available: {', '.join(option.choices)}" if option.choices else f"it must be {option.metavar}"
        raise InputError(f"{option.spelling} {said}; {wanted}.")
    kinds = elements[:1] * len(words) if elements[-1] is Ellipsis else elements
    plain = [_plain(word, element) for word, element in zip(words, kinds, strict=True)]
    return from_plain(plain if get_origin(option.kind) is tuple else plain[0], option.kind, option.spelling)


def _plain(word: str, kind: Any) -> Any:
    """Return what a word stands for, as JSON would hold it; a word that is not of its type stays, and is refused."""
    kind = get_args(kind)[0] if get_origin(kind) is Annotated else kind
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


def _metavar(kind: Any) -> str:
    kind = get_args(kind)[0] if get_origin(kind) is Annotated else kind
    if get_origin(kind) is Literal:
        return "{" + ",".join(map(str, get_args(kind))) + "}"
    return _METAVARS.get(kind, str(kind.__name__).upper())


def _refuse_unknown(word: str, kind: type, command: str) -> NoReturn:
    flag = word.partition("=")[0]
    cure = did_you_mean(flag, flags_of(kind)) if flag.startswith("--") else None
    cure = cure or f"see gaussian-trimmer {command} --help."
    raise InputError(f"{clip_name(flag)} is not an option or argument of '{command}'; {cure}")
