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
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import MISSING
from functools import cache
from itertools import pairwise

from gaussian_trimmer.options import Option, options_of

HELP_ALL = "--help-all"
_MAX_WIDTH, _TEXT_INDENT, _COLUMN = 110, 8, 26
_FIRST_SENTENCE = re.compile(r".*?\.(?=\s[A-Z`]|$)", re.DOTALL)


def help_on(kind: type, prog: str, *, everything: bool) -> str:
    """What a command does and takes.

    Args:
        kind: the command's dataclass.
        prog: how the command is called.
        everything: list every setting, not just the usual options.
    """
    width = min(shutil.get_terminal_size().columns, _MAX_WIDTH)
    options = [option for option in options_of(kind) if not option.is_hidden]
    groups = _by_stage(options) if everything else _common(options, kind)
    places = [option for option in options if option.is_positional]
    words = [option.metavar if option.default is MISSING else f"[{option.metavar}]" for option in places]
    lines = [" ".join([f"usage: {prog} [-h] [OPTIONS]", *words])]
    paragraphs = inspect.cleandoc(kind.__doc__ or "").split("\n\n")
    for paragraph in paragraphs if everything else paragraphs[:1]:
        lines += ["", _wrapped(paragraph, width)]
    for title, group in groups.items():
        lines += ["", f"{title}:"] if title else [""]
        for option in group:
            lines += _in_full(option, width) if everything else _in_short(option, width)
    if examples := getattr(kind, "EXAMPLES", ()):
        lines += ["", "examples:", *(_command(example, width) for example in examples)]
    left = len(options) - sum(map(len, groups.values()))
    if left > 0:
        lines += ["", f"There are {left} more settings: {prog} {HELP_ALL}"]
    elif not everything:
        lines += ["", f"In full: {prog} {HELP_ALL}"]
    return "\n".join(lines)


def _by_stage(options: Iterable[Option]) -> dict[str, list[Option]]:
    """All options, by what comes before the dot in their names."""
    groups: dict[str, list[Option]] = {"positional arguments": [], "options": []}
    for option in options:
        stage = option.name.rpartition(".")[0]
        title = "positional arguments" if option.is_positional else f"{stage} options".lstrip()
        groups.setdefault(title, []).append(option)
    return {title: group for title, group in groups.items() if group}


def _common(options: list[Option], kind: type) -> dict[str, list[Option]]:
    """What short help lists: what the command says, in its order; else all but the settings of stages."""
    named = {option.flags[0]: option for option in options if not option.is_positional}
    common: Mapping[str, tuple[str, ...]] = getattr(
        kind, "COMMON_OPTIONS", {"options": tuple(flag for flag in named if "." not in flag)}
    )
    groups = {"": [option for option in options if option.is_positional]}
    groups |= {title: [named[flag] for flag in flags] for title, flags in common.items()}
    return {title: group for title, group in groups.items() if group}


def _head(option: Option) -> str:
    if option.is_positional:
        return option.metavar
    if option.kind is bool:
        return ", ".join(option.flags) if option.default else option.flags[0]
    return f"{option.flags[0]} {option.metavar}"


def _in_full(option: Option, width: int) -> Iterator[str]:
    yield f"  {_head(option)}"
    if words := " ".join(filter(None, (_words(option), _hint(option)))):
        yield _wrapped(words, width, " " * _TEXT_INDENT)


def _in_short(option: Option, width: int) -> Iterator[str]:
    """The option, and beside it the first sentence of what is said of it."""
    first = _FIRST_SENTENCE.match(_words(option))
    words = " ".join(filter(None, (first[0].rstrip(".") if first else _words(option), _hint(option))))
    head = f"  {_head(option)}"
    if len(head) > _COLUMN - 2:
        yield head
        head = ""
    yield textwrap.fill(words, width, initial_indent=head.ljust(_COLUMN), subsequent_indent=" " * _COLUMN)


def _words(option: Option) -> str:
    return " ".join(_docstrings(option.owner).get(option.path[-1], "").split())


def _hint(option: Option) -> str:
    hint = next((note.help_behavior_hint for note in option.notes if getattr(note, "help_behavior_hint", None)), "")
    if not hint and option.default not in (MISSING, None, "", ()) and option.default is not False:
        hint = f"(default: {' '.join(option.reader.str_from_instance(option.default))})"
    return str(hint)


def _command(example: str, width: int) -> str:
    return textwrap.fill(
        example, width, initial_indent="  ", subsequent_indent="      ", break_long_words=False, break_on_hyphens=False
    )


@cache
def _docstrings(kind: type) -> dict[str, str]:
    """What stands below each field in the source of a dataclass and of those that it inherits from."""
    found: dict[str, str] = {}
    for owner in reversed(kind.__mro__[:-1]):
        (tree,) = ast.parse(textwrap.dedent(inspect.getsource(owner))).body
        assert isinstance(tree, ast.ClassDef)
        for field, below in pairwise(tree.body):
            match field, below:
                case ast.AnnAssign(target=ast.Name(name)), ast.Expr(value=ast.Constant(str(text))):
                    found[name] = text
    return found


def _wrapped(words: str, width: int, indent: str = "") -> str:
    return textwrap.fill(" ".join(words.split()), width, initial_indent=indent, subsequent_indent=indent)
