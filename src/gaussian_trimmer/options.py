"""Dataclasses as options of the command line: each field is one, and so is each field of the dataclasses within.

    @dataclass(frozen=True)
    class Convert:
        source: Annotated[Positional[Path], arg(metavar="SOURCE")]
        sort: bool = False

is made by `parse(Convert, ["a.ply", "--sort"], "convert")`. The notes on types are tyro's, which also reads the values.
The options in a manifest of a batch are read in the same way.
"""

from __future__ import annotations

import re
import types
from collections import deque
from collections.abc import Hashable, Iterable, Iterator, Sequence
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass, replace
from functools import cache, cached_property
from typing import Annotated, Any, NoReturn, TypeVar, Union, cast, get_args, get_origin

from tyro.conf import Positional, Suppress, UseAppendAction
from tyro.constructors import ConstructorRegistry, PrimitiveConstructorSpec, PrimitiveTypeInfo

from gaussian_trimmer.cameras import AXIS, vector_of_up
from gaussian_trimmer.errors import InputError, did_you_mean, shown
from gaussian_trimmer.settings import hints_of

Path = tuple[str, ...]
Made = TypeVar("Made")
UP = "X Y Z, or an axis such as z or -y"
_FLAG = re.compile(r"--[^\s=]*(=.*)?", re.DOTALL)
"""Unlike a text of several options, such as "--views 7 --quiet", which is a value."""
_NEGATIVE_NUMBER = re.compile(r"-[\d.]")
_METAVAR_MEANINGS = {"INT": "a whole number", "FLOAT": "a number"}


@dataclass(frozen=True)
class Option:
    """One option or positional argument."""

    owner: type
    """The dataclass that has the field."""
    path: Path
    """Names of the fields that lead to it from the command."""
    name: str
    """What it is called, without the dashes."""
    type: Any
    default: Any
    """`MISSING` if the option must be given."""

    @cached_property
    def notes(self) -> tuple[Any, ...]:
        """What `Annotated` says of the type."""
        return getattr(self.type, "__metadata__", ())

    @property
    def is_positional(self) -> bool:
        """Whether it has no flag."""
        return Positional in self.notes

    @property
    def is_repeated(self) -> bool:
        """Whether it may be given several times; its field has a tuple of all that is given."""
        return UseAppendAction in self.notes

    @property
    def is_hidden(self) -> bool:
        """Whether it has no flag: its field has the names and values of all repeated options, in the order given."""
        return Suppress in self.notes

    @cached_property
    def kind(self) -> Any:
        """The type of one value, without None."""
        kind = self.type
        while get_origin(kind) in (Annotated, Union, types.UnionType):
            kind = next(argument for argument in get_args(kind) if argument is not types.NoneType)
        return get_args(kind)[0] if self.is_repeated else kind

    @cached_property
    def reader(self) -> PrimitiveConstructorSpec[Any]:
        """How tyro reads and writes the values."""
        found = ConstructorRegistry.get_primitive_spec(PrimitiveTypeInfo.make(self.kind, set()))
        assert isinstance(found, PrimitiveConstructorSpec), self.name
        return found

    @cached_property
    def metavar(self) -> str:
        """What stands for the value in help."""
        if self.name == "up":
            return UP
        return next((note.metavar for note in self.notes if getattr(note, "metavar", None)), self.reader.metavar)

    @property
    def flags(self) -> tuple[str, ...]:
        """How it is spelt; the second spelling means False."""
        if self.kind is not bool:
            return (f"--{self.name}",)
        group, dot, last = self.name.rpartition(".")
        return f"--{self.name}", f"--{group}{dot}no-{last}"

    @property
    def spelling(self) -> str:
        """What messages call it."""
        return self.metavar if self.is_positional else self.flags[0]


def parse(kind: type[Made], words: Sequence[str], command: str) -> Made:
    """A command, or a part of one, from what was typed after its name.

    Where the preset is that of the paper, what is given beside it counts all the same.

    Args:
        kind: a dataclass.
        words: the words that were typed.
        command: what messages call it.

    Raises:
        InputError: an argument is missing, unknown or not possible.
    """
    given = _values(kind, words, command)
    for option in options_of(cast(Hashable, kind)):
        if option.default is MISSING and option.path not in given:
            raise InputError(f"'{command}' needs {option.spelling}; see gaussian-trimmer {command} --help.")
    made: Any = kind(**{path[0]: value for path, value in given.items() if len(path) == 1})
    if given.get(("preset",)) == "paper":
        from gaussian_trimmer.config import with_paper_preset  # late, since most commands need none of the stages

        made = with_paper_preset(made)
    for path, value in given.items():
        made = _with(made, path, value)
    return made  # type: ignore[no-any-return]


@cache
def options_of(kind: type) -> tuple[Option, ...]:
    """All options of a dataclass, in the order of its fields."""
    return tuple(_options_in(kind, (), ""))


def _options_in(kind: type, path: Path, prefix: str) -> Iterator[Option]:
    for field in fields(kind):
        hint = hints_of(kind)[field.name]
        names = [note.name for note in getattr(hint, "__metadata__", ()) if getattr(note, "name", None) is not None]
        own = names[0] if names and isinstance(names[0], str) else field.name
        name, default = ".".join(filter(None, (prefix, own.replace("_", "-")))), _default_of(field)
        if is_dataclass(default):
            yield from _options_in(type(default), (*path, field.name), name)
        else:
            yield Option(kind, (*path, field.name), name, hint, default)


def _default_of(field: Field[Any]) -> Any:
    return field.default if field.default_factory is MISSING else field.default_factory()


def _with(settings: Any, path: Path, value: Any) -> Any:
    """Settings with another value for one of their fields, or for one of a dataclass within."""
    first, *rest = path
    return replace(settings, **{first: _with(getattr(settings, first), tuple(rest), value) if rest else value})


@cache
def _flags_of(kind: type) -> dict[str, tuple[Option, bool]]:
    """All flags, with the option that they set and, of those without a value, what they set it to."""
    named = [option for option in options_of(kind) if not (option.is_positional or option.is_hidden)]
    return {flag: (option, number == 0) for option in named for number, flag in enumerate(option.flags)}


def _values(kind: type, words: Sequence[str], command: str) -> dict[Path, Any]:
    """The values that are given, by the paths of their options."""
    given: dict[Path, Any] = {}
    repeated: list[tuple[str, Any]] = []
    places = deque(option for option in options_of(kind) if option.is_positional)
    left = deque(words)
    while left:
        word = left[0]
        if word.startswith("--") or (word.startswith("-") and not _NEGATIVE_NUMBER.match(word)):
            left.popleft()
            flag, equals, value = word.partition("=")
            option, is_on = _flags_of(kind).get(flag.replace("_", "-"), (None, False))
        else:
            option, is_on, equals, value = places.popleft() if places else None, False, "", ""
        if option is None:
            _refuse_unknown(word, _flags_of(kind), command)
        if option.kind is bool and not equals:
            given[option.path] = is_on
            continue
        found = _value(option, deque([value]) if equals else left)
        if option.is_repeated:
            repeated.append((option.path[-1], found))
            found = (*given.get(option.path, ()), found)
        given[option.path] = found
    given.update({option.path: tuple(repeated) for option in options_of(kind) if option.is_hidden})
    return given


def _value(option: Option, left: deque[str]) -> Any:
    """The value that the next words are; they are taken out."""
    takes = option.reader.nargs
    count = takes if isinstance(takes, int) else len(left)
    words: list[str] = []
    while left and len(words) < count and not _FLAG.fullmatch(left[0]):
        word = left.popleft()
        if option.name == "up" and not words and AXIS.fullmatch(word):
            return vector_of_up(word)
        words += filter(None, re.split("[,/]", word)) if isinstance(takes, int) and takes > 1 else [word]
    try:
        if isinstance(takes, int) and len(words) != takes:
            raise ValueError
        return option.reader.instance_from_str(words)
    except ValueError as error:
        given = f"is '{shown(' '.join(words))}'" if words else "has no value"
        raise InputError(f"{option.spelling} {given}; {_wanted(option)}.") from error


def _wanted(option: Option) -> str:
    """What a value may be."""
    if option.name == "up":
        return f"it must be {UP}"
    if option.reader.choices:
        return f"available: {', '.join(option.reader.choices)}"
    kinds = {_METAVAR_MEANINGS.get(kind, option.metavar) for kind in re.findall("[A-Z]+", option.reader.metavar)}
    if option.reader.nargs == 1:
        return f"it must be {kinds.pop()}"
    if isinstance(option.reader.nargs, int):
        return f"it must be {option.metavar}, {option.reader.nargs} numbers with spaces between them"
    return f"it must be {kinds.pop()}, or several with spaces between them"


def _refuse_unknown(word: str, flags: Iterable[str], command: str) -> NoReturn:
    flag = word.partition("=")[0]
    cure = did_you_mean(flag, flags) if flag.startswith("--") else None
    cure = cure or f"see gaussian-trimmer {command} --help."
    raise InputError(f"{shown(flag)} is not an option or argument of '{command}'; {cure}")
