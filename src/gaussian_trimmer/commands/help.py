"""Help on a command: its options and what the docstrings of their fields say."""

from __future__ import annotations

import ast
import inspect
import shutil
import textwrap
from collections.abc import Iterator
from dataclasses import MISSING
from functools import cache
from itertools import pairwise
from typing import Any

from gaussian_trimmer.options import Option, options_of

HELP_ALL = "--help-all"
_MAX_WIDTH, _TEXT_INDENT = 110, 8


def help_on(kind: type, prog: str, *, everything: bool) -> str:
    """What a command does and takes.

    Args:
        kind: the command's dataclass.
        prog: how the command is called.
        everything: list every setting, not just the usual options.
    """
    width = min(shutil.get_terminal_size().columns, _MAX_WIDTH)
    options = [option for option in options_of(kind) if not option.is_hidden]
    listed = options if everything else _common(options, kind)
    places = [option.metavar for option in options if option.is_positional]
    lines = [" ".join([f"usage: {prog} [-h] [OPTIONS]", *places])]
    for paragraph in inspect.cleandoc(kind.__doc__ or "").split("\n\n"):
        lines += ["", _wrapped(paragraph, width)]
    groups: dict[str, list[Option]] = {"positional arguments": [], "options": []}
    for option in listed:
        groups.setdefault(_title(option), []).append(option)
    for title, group in groups.items():
        lines += ["", f"{title}:"] if group else []
        for option in group:
            lines += [f"  {_head(option)}", *_body(option, width)]
    if len(listed) < len(options):
        lines += ["", f"There are {len(options) - len(listed)} more settings: {prog} {HELP_ALL}"]
    return "\n".join(lines)


def _common(options: list[Option], kind: type) -> list[Option]:
    """What short help lists: what the command says, in its order; else all but the settings of stages."""
    common: tuple[str, ...] | None = getattr(kind, "COMMON_OPTIONS", None)
    if common is None:
        return [option for option in options if "." not in option.name]
    flags = {option.flags[0]: option for option in options if not option.is_positional}
    return [*(option for option in options if option.is_positional), *(flags[flag] for flag in common)]


def _title(option: Option) -> str:
    if option.is_positional:
        return "positional arguments"
    return f"{option.name.rpartition('.')[0]} options".lstrip()


def _head(option: Option) -> str:
    if option.is_positional:
        return option.metavar
    if option.kind is bool:
        return ", ".join(option.flags) if option.default else option.flags[0]
    return f"{option.flags[0]} {option.metavar}"


def _body(option: Option, width: int) -> Iterator[str]:
    words = _docstrings(option.owner).get(option.path[-1], "")
    hint = next((note.help_behavior_hint for note in option.notes if getattr(note, "help_behavior_hint", None)), "")
    if not hint and option.default not in (MISSING, None, "", ()) and option.default is not False:
        hint = f"(default: {' '.join(option.reader.str_from_instance(option.default))})"
    if words or hint:
        yield _wrapped(f"{words} {hint}", width, _TEXT_INDENT)


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


def _wrapped(words: Any, width: int, indent: int = 0) -> str:
    return textwrap.fill(" ".join(words.split()), width, initial_indent=" " * indent, subsequent_indent=" " * indent)
