"""The command line, by argparse: how the words of a command are read, what its help shows, and settings by name.

    def add_arguments(parser: Parser) -> None:
        parser.describe("Convert a splat file.", run, examples=["gaussian-trimmer convert scene.ply scene.spz"])
        parser.add_argument("source", kind=Path, help="File to read")
        results = parser.add_argument_group("results")
        results.add_argument("--overwrite", kind=bool, help="Replace the target if it exists")

is all that a command says. `kind` is a type as fields of settings have it, with a `Range` or choices: every value
passes the check of `settings`. Rare settings have no flag; `--set stage.name=value` changes them.
"""

from __future__ import annotations

import argparse
import re
import shutil
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from itertools import chain
from types import MappingProxyType
from typing import Any, NoReturn

from gaussian_trimmer.cameras import AXIS, vector_of_up
from gaussian_trimmer.errors import InputError, clip_name, did_you_mean
from gaussian_trimmer.settings import docstrings, elements_of, from_words, hints_of, metavar_of, settings_in

PROGRAM = "gaussian-trimmer"
UP = "X Y Z, or an axis such as z or -y"
"""The kind of an option that is an up vector."""
_NUMBER = re.compile(r"-?[\d.][\d.e+-]*")
_MAX_WIDTH, _COLUMN = 110, 26


class Option(argparse.Action):
    """An argument that is given once at most, and whose value is checked and becomes what its kind says."""

    def __init__(
        self, option_strings: Sequence[str], dest: str, *, kind: Any = str, metavar: str | None = None,
        rare: bool = False, **more: Any,
    ) -> None:  # fmt: skip
        self.kind, self.rare, elements = kind, rare, elements_of(kind)
        if kind is bool:
            option_strings = [*option_strings, f"--no-{option_strings[0][2:]}"]
            more = {"default": False, "nargs": 0} | more
        elif elements is not None:
            more.setdefault("nargs", "+" if elements[-1] is Ellipsis else len(elements))
        if elements is not None and elements[-1] is Ellipsis:
            more.setdefault("default", ())
        super().__init__(option_strings, dest, metavar=metavar or (UP if kind is UP else metavar_of(kind)), **more)
        if self.default not in (None, False, (), argparse.SUPPRESS) and self.help:
            self.help += f" (default: {'yes' if self.default is True else self.default})"

    @property
    def spelling(self) -> str:
        """What messages call it."""
        return self.option_strings[0] if self.option_strings else str(self.metavar)

    def __call__(self, parser: Any, namespace: argparse.Namespace, values: Any, option_string: Any = None) -> None:
        """Take the words that were given for it."""
        if not self.option_strings and values is self.default:
            return setattr(namespace, self.dest, values)
        self.store(namespace, option_string != self.option_strings[1] if self.kind is bool else self._value(values))
        return None

    def store(self, namespace: argparse.Namespace, value: Any) -> None:
        """Keep a value, the only one."""
        if self.dest in namespace.given:
            raise InputError(f"{self.spelling} is given twice; leave one out.")
        namespace.given.add(self.dest)
        setattr(namespace, self.dest, value)

    def words(self, value: Any) -> list[str]:
        """Return the words that give it a value."""
        if self.kind is bool:
            return [self.option_strings[0 if value else 1]]
        values = value if isinstance(value, tuple) else [value]
        texts = [repr(v).removesuffix(".0") if isinstance(v, float) else str(v) for v in values]
        if not self.option_strings or not texts[0].startswith("-") or _NUMBER.fullmatch(texts[0]):
            return [*self.option_strings[:1], *texts]
        return [f"{self.spelling}={' '.join(texts)}"]

    def _value(self, words: Any) -> Any:
        words = [words] if isinstance(words, str) else words
        words = [word.strip() if _NUMBER.fullmatch(word.strip()) else word for word in words]
        return up_vector(words, self.spelling) if self.kind is UP else from_words(words, self.kind, self.spelling)


class Repeated(Option):
    """An option that may be given several times; all values are kept."""

    def store(self, namespace: argparse.Namespace, value: Any) -> None:
        """Add a value to those given before."""
        setattr(namespace, self.dest, (*(getattr(namespace, self.dest) or ()), value))


class Mark(Option):
    """An option that takes effect in the order given; `in_order` has the names and values of all of these."""

    def store(self, namespace: argparse.Namespace, value: Any) -> None:
        """Add its name and value to those given before."""
        namespace.in_order = (*namespace.in_order, (self.dest, value))


class Parser(argparse.ArgumentParser):
    """Reads the words of one command.

    Args:
        command: its name.
        gone: options that there were, and what takes the place of each.
    """

    def __init__(self, command: str, gone: Mapping[str, str] = MappingProxyType({})) -> None:
        super().__init__(
            prog=f"{PROGRAM} {command}", formatter_class=_Formatter, allow_abbrev=False, add_help=False,
            exit_on_error=False,
        )  # fmt: skip
        self.command, self.settings, self.gone = command, dict[str, Any](), gone
        self.about, self.examples = list[str](), tuple[str, ...]()
        for name, action in ((None, Option), ("repeated", Repeated), ("mark", Mark)):
            self.register("action", name, action)

    def describe(self, about: str, run: Callable[[Any], int | None], examples: Sequence[str] = ()) -> None:
        """Say what the command does, how it is called, and the function that runs it."""
        self.about = [textwrap.fill(" ".join(part.split()), _width()) for part in about.split("\n\n")]
        self.examples = tuple(examples)
        self.set_defaults(run=run)

    def add_fields(self, title: str, kind: type) -> None:
        """Add a group of rare options that are the fields of a dataclass."""
        group, texts = self.add_argument_group(title), docstrings(kind)
        for field in fields(kind):
            flag, help = f"--{field.name.replace('_', '-')}", " ".join(texts[field.name].split()).rstrip(".")
            group.add_argument(flag, kind=hints_of(kind)[field.name], default=field.default, help=help, rare=True)

    def add_settings(self, group: Any, *kinds: type, **further: type) -> None:
        """Add `--set` for the fields of dataclasses; names of further ones begin with a name and a dot."""
        help = "Change a setting by its name; --help-all lists them"
        group.add_argument("--set", action="repeated", metavar="NAME=VALUE", default=(), help=help)
        for kind in kinds:
            self.settings |= settings_in(kind)
        for name, one in further.items():
            self.settings |= settings_in(one, f"{name}.")

    def parse(self, words: Sequence[str], base: argparse.Namespace | None = None) -> argparse.Namespace:
        """Return the values of all arguments, and in `given` the names of those that the words give.

        Args:
            words: what was typed after the command's name.
            base: values to which the words are added, in place of the defaults.

        Raises:
            InputError: an argument is missing, unknown, given twice, or not possible.
        """
        prepared = self._prepared(words)
        for word in prepared:
            if word.startswith("-"):
                self._refuse_unknown(word.partition("=")[0])
        for action in self._actions if base is not None else ():
            if getattr(base, action.dest) not in (None, ()):
                action.required, action.default = False, getattr(base, action.dest)
                action.nargs = action.nargs if action.option_strings else "?"
        start = argparse.Namespace(parser=self, typed=words, given=set(), in_order=getattr(base, "in_order", ()))
        try:
            arguments, left = self.parse_known_intermixed_args(prepared, start)
        except argparse.ArgumentError as error:
            if error.argument_name is None:  # of Python 3.13 and later, what is missing
                self.error(error.message)
            action = next(action for action in self._actions if error.argument_name in _names(action))
            wrong = "takes no value" if action.nargs == 0 else f"must be {action.metavar}"
            if action.choices is None and "expected" in error.message and action.nargs is None:
                wrong = f"has no value; it must be {action.metavar}"
            raise InputError(f"{error.argument_name} {wrong}.") from error
        if left:
            raise InputError(f"{clip_name(left[0])} is not an option or argument of '{self.command}'; see {self._see}.")
        arguments.settings = dict(map(self._setting, getattr(arguments, "set", ())))
        return arguments

    def error(self, message: str) -> NoReturn:
        """Raise what argparse finds missing.

        Raises:
            InputError: always.
        """
        raise InputError(f"'{self.command}' needs {message.partition(': ')[2]}; see {self._see}.")

    def format_help(self) -> str:
        """Return what `--help` shows: the options that people use."""
        hidden = [action for action in self._actions if getattr(action, "rare", False)]
        for action in hidden:
            action.help = argparse.SUPPRESS
        more = f"{len(hidden)} rare options and {len(self.settings)} settings: " if hidden else ""
        return self._help(self.about[:1], f"{more}{self.prog} --help-all" if more else "")

    def format_help_all(self) -> str:
        """Return what `--help-all` shows: also rare options, and every setting for `--set`."""
        lines, indent = ["settings, for --set NAME=VALUE:"], " " * _COLUMN
        for name, (kind, field, hint) in self.settings.items():
            head, text = f"  {name}={metavar_of(hint).replace(' ', ',')}", " ".join(docstrings(kind)[field].split())
            default = getattr(kind(), field)
            text += "" if default in (None, "", (), False) else f" (default: {default})"
            text = textwrap.fill(text, _width(), initial_indent=indent, subsequent_indent=indent)
            lines.append(f"{head:{_COLUMN}}{text[_COLUMN:]}" if len(head) < _COLUMN - 1 else f"{head}\n{text}")
        return self._help(self.about, "\n".join(lines) if self.settings else "")

    def _help(self, about: Sequence[str], last: str) -> str:
        places = [action for action in self._actions if not action.option_strings]
        shown = [str(place.metavar) if place.required else f"[{place.metavar}]" for place in places]
        self.usage = " ".join([self.prog, "[-h]", "[OPTIONS]", *shown])
        examples = ["\n".join(["examples:", *(f"  {example}" for example in self.examples)])] if self.examples else []
        self.description, self.epilog = "\n\n".join(about), "\n\n".join([*examples, *filter(None, [last])])
        return super().format_help().rstrip("\n")

    def words_of(self, arguments: argparse.Namespace, *left_out: str) -> list[str]:
        """Return the words of a command that gives the same arguments, without some of them, by name."""
        words, marks = [self.command], dict[str, Option]()
        for action in sorted(self._actions, key=lambda action: bool(action.option_strings)):
            if isinstance(action, Mark):
                marks[action.dest] = action
            elif isinstance(action, Repeated):
                words += chain.from_iterable(map(action.words, getattr(arguments, action.dest)))
            elif isinstance(action, Option) and action.dest not in left_out:
                value = getattr(arguments, action.dest, action.default)
                words += action.words(value) if value != self.get_default(action.dest) else []
        return [*words, *chain.from_iterable(marks[name].words(value) for name, value in arguments.in_order)]

    @property
    def _see(self) -> str:
        return f"{self.prog} --help"

    def _prepared(self, words: Sequence[str]) -> list[str]:
        """Return words as argparse can read them: an up vector as one, values that begin with a dash held fast."""
        prepared, left = list[str](), list(words)
        while left:
            word = left.pop(0)
            if word == "--up" and left:
                taken = 1 if AXIS.fullmatch(left[0]) else next(
                    (i for i, number in enumerate(left[:4]) if not _NUMBER.fullmatch(number)), len(left[:4])
                )  # fmt: skip
                word = f"--up={','.join(left[: max(taken, 1)])}"
                del left[: max(taken, 1)]
            elif word == "--options" and left:  # a text of options is a value
                word = f"--options={left.pop(0)}"
            prepared.append(f" {word}" if _NUMBER.fullmatch(word) and word.startswith("-") else word)
        return prepared

    def _refuse_unknown(self, flag: str) -> None:
        known = self._option_string_actions
        if flag in known:
            return
        if flag in self.gone:
            raise InputError(f"{flag} is gone. {self.gone[flag]}")
        name = flag.lstrip("-").replace("_", "-")
        setting = next((known for known in self.settings if name and f".{known}".endswith(f".{name}")), None)
        cure = f"write --set {setting}={metavar_of(self.settings[setting][2])}." if setting else None
        offered = [one for one in known if not one.startswith("--no-") or known[one].default is True]
        cure = cure or (did_you_mean(flag, offered) if flag.startswith("--") else None) or f"see {self._see}."
        raise InputError(f"{clip_name(flag)} is not an option or argument of '{self.command}'; {cure}")

    def _setting(self, text: str) -> tuple[str, Any]:
        """Return the name of a setting and its value from NAME=VALUE."""
        name, equals, value = text.partition("=")
        name = name.replace("_", "-")
        if not equals or name not in self.settings:
            if name in self.settings:
                raise InputError(f"--set {name} has no value; write --set {name}={metavar_of(self.settings[name][2])}.")
            cure = did_you_mean(name, self.settings) or f"{self.prog} --help-all lists all."
            raise InputError(f"--set {clip_name(name)}: there is no such setting; {cure}")
        hint = self.settings[name][2]
        words = value.split(",") if elements_of(hint) is not None else [value]
        return name, from_words(words, hint, name)


def up_vector(words: list[str], where: str) -> tuple[float, ...]:
    """Return an up vector from three or four numbers with commas, or from an axis."""
    (text,) = words
    try:
        return vector_of_up([float(number) for number in text.split(",")] if "," in text else text)
    except ValueError as error:  # also of what is no up vector
        raise InputError(f"{where} is '{clip_name(text.replace(',', ' '))}'; it must be {UP}.") from error


class _Formatter(argparse.RawDescriptionHelpFormatter):
    def __init__(self, prog: str) -> None:
        super().__init__(prog, max_help_position=_COLUMN, width=_width())

    def _format_args(self, action: argparse.Action, default_metavar: str) -> str:
        return str(action.metavar)

    def _format_action_invocation(self, action: argparse.Action) -> str:
        if not action.option_strings:
            return str(action.metavar)
        if action.nargs == 0:
            return f"--[no-]{action.option_strings[0][2:]}" if action.default is True else action.option_strings[0]
        return f"{action.option_strings[0]} {action.metavar}"


def _width() -> int:
    return min(shutil.get_terminal_size().columns, _MAX_WIDTH)


def _names(action: argparse.Action) -> tuple[str, ...]:
    return ("/".join(action.option_strings), *action.option_strings, str(action.metavar), action.dest)
