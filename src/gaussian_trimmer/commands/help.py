"""Help on a command: its options and what the docstrings of their fields say.

A command names the options that people use in `COMMON_OPTIONS`, by groups, and shows how it is called in `EXAMPLES`.
Short help has those, with the first sentence of each; `--help-all` has every setting, in full.
"""

from __future__ import annotations

import ast
import inspect
import re
import shutil
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import MISSING
from functools import cache
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

from gaussian_trimmer.options import Option, options_of, parse

HELP_ALL = "--help-all"
_MAX_WIDTH, _COLUMN = 110, 26
_FIRST_SENTENCE = re.compile(r".*?\.(?=\s[A-Z`]|$)", re.DOTALL)


def help_on(kind: type, prog: str, *, everything: bool) -> str:
    """Return what a command does and takes.

    Args:
        kind: the command's dataclass.
        prog: how the command is called.
        everything: list every setting, not just the usual options.
    """
    width = min(shutil.get_terminal_size().columns, _MAX_WIDTH)
    options = [option for option in options_of(kind) if not option.note.order]
    groups = _by_stage(options) if everything else _common(options, kind)
    places = [option for option in options if option.note.positional]
    words = [option.metavar if option.default is MISSING else f"[{option.metavar}]" for option in places]
    lines = [" ".join([f"usage: {prog} [-h] [OPTIONS]", *words])]
    paragraphs = inspect.cleandoc(kind.__doc__ or "").split("\n\n")
    for paragraph in paragraphs if everything else paragraphs[:1]:
        lines += ["", textwrap.fill(" ".join(paragraph.split()), width)]
    for title, group in groups.items():
        lines += ["", f"{title}:"] if title else [""]
        lines += [_beside(_head(option), _text(option, in_full=everything), width) for option in group]
    if examples := getattr(kind, "EXAMPLES", ()):
        lines += ["", "examples:"]
        lines += [_wrapped(example, width, "  ", "      ") for example in examples]
    left = len(options) - sum(map(len, groups.values()))
    if left > 0:
        lines += ["", f"There are {left} more settings: {prog} {HELP_ALL}"]
    elif not everything:
        lines += ["", f"In full: {prog} {HELP_ALL}"]
    return "\n".join(lines)


def _by_stage(options: Iterable[Option]) -> dict[str, list[Option]]:
    """Return all options, by what comes before the dot in their names."""
    groups: dict[str, list[Option]] = {"positional arguments": [], "options": []}
    for option in options:
        stage = option.name.rpartition(".")[0]
        title = "positional arguments" if option.note.positional else f"{stage} options".lstrip()
        groups.setdefault(title, []).append(option)
    return {title: group for title, group in groups.items() if group}


def _common(options: list[Option], kind: type) -> dict[str, list[Option]]:
    """Return what short help lists: what the command says, in its order; else all but the settings of stages."""
    named = {option.flags[0]: option for option in options if not option.note.positional}
    common = getattr(kind, "COMMON_OPTIONS", {"options": [flag for flag in named if "." not in flag]})
    groups = {"": [option for option in options if option.note.positional]}
    groups |= {title: [named[flag] for flag in flags] for title, flags in common.items()}
    return {title: group for title, group in groups.items() if group}


def _head(option: Option) -> str:
    if option.note.positional:
        return option.metavar
    if option.kind is bool:
        return ", ".join(option.flags) if option.default else option.flags[0]
    return f"{option.flags[0]} {option.metavar}"


def _text(option: Option, *, in_full: bool) -> str:
    """Return what is said of an option, or the first sentence of it, and its default."""
    words = " ".join(_docstrings(option.owner).get(option.path[-1], "").split())
    if not in_full and (first := _FIRST_SENTENCE.match(words)):
        words = first[0].rstrip(".")
    default = option.note.default
    if not default and option.default not in (MISSING, None, "", (), False):
        given = option.default if isinstance(option.default, tuple) else (option.default,)
        default = " ".join(map(str, given))
    return f"{words} (default: {default})" if default else words


def _beside(head: str, text: str, width: int) -> str:
    """Return an option and, in a column beside or below it, a text."""
    fits = len(head) < _COLUMN - 3
    column = " " * _COLUMN
    filled = _wrapped(text, width, f"  {head}".ljust(_COLUMN) if fits else column, column)
    return filled if fits else f"  {head}\n{filled}".rstrip()


def _wrapped(text: str, width: int, first: str, further: str) -> str:
    return textwrap.fill(
        text, width, initial_indent=first, subsequent_indent=further, break_long_words=False, break_on_hyphens=False
    )


@cache
def _docstrings(kind: type) -> dict[str, str]:
    """Return what stands below each field in the source of a dataclass and of those that it inherits from."""
    found: dict[str, str] = {}
    for owner in reversed(kind.__mro__[:-1]):
        (tree,) = ast.parse(textwrap.dedent(inspect.getsource(owner))).body
        assert isinstance(tree, ast.ClassDef)
        for field, below in pairwise(tree.body):
            match field, below:
                case ast.AnnAssign(target=ast.Name(name)), ast.Expr(value=ast.Constant(str(text))):
                    found[name] = text
    return found


class DataclassParser:
    """Reads the words of a command that is a dataclass."""

    def __init__(self, command: str, kind: Any) -> None:
        self.command, self.kind = command, kind

    def parse(self, words: Sequence[str]) -> Any:
        """Return something whose `run` runs the command."""
        made = parse(self.kind, words, self.command)
        return SimpleNamespace(run=lambda _: made.run(), made=made)

    def format_help(self, everything: bool = False) -> str:
        """Return what `--help` shows."""
        return help_on(self.kind, f"gaussian-trimmer {self.command}", everything=everything)

    def format_help_all(self) -> str:
        """Return what `--help-all` shows."""
        return self.format_help(everything=True)
