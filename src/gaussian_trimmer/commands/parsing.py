"""What is typed after a command: tyro parses it, and its help and its errors are put into plain words."""

from __future__ import annotations

import os
import re
import shutil
import textwrap
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from io import BytesIO, TextIOWrapper
from itertools import takewhile
from typing import Any, NoReturn

import tyro

from gaussian_trimmer.errors import InputError

HELP_ALL = "--help-all"
_AXES = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}
_AXIS = re.compile(r"[+-]?[xyzXYZ]")
_PARSED_WIDTH, _WIDEST_HELP, _INDENT = "100", 110, 8
_OPTION = re.compile(r"--[A-Za-z][\w.-]*")


class _Captured(TextIOWrapper):
    """What is printed, with the characters that tyro draws its boxes of."""

    def __init__(self) -> None:
        super().__init__(BytesIO(), encoding="utf-8")

    def text(self) -> str:
        self.seek(0)
        return self.read()


def parse(kind: type[Any], prog: str, arguments: Sequence[str], default: Any = None) -> Any:
    """A command made from its arguments; `--help` prints the usual options, `--help-all` every setting.

    Raises:
        InputError: an argument is missing, unknown or not possible.
        SystemExit: help was asked for and has been printed.
    """
    wants_all = HELP_ALL in arguments
    given = ["--help"] if wants_all else _axes_as_vectors(arguments)
    printed, complaint = _Captured(), _Captured()
    more = {} if default is None else {"default": default}
    try:
        with redirect_stdout(printed), redirect_stderr(complaint), _one_column():
            return tyro.cli(kind, prog=prog, args=given, **more)
    except SystemExit as end:
        if end.code:
            _refuse(complaint.text(), prog.partition(" ")[2], given)
        text = printed.text()
        print(_help(text, kind, prog, everything=wants_all) if text.startswith("usage:") else text, end="")
        raise


@contextmanager
def _one_column() -> Iterator[None]:
    """A terminal so narrow that tyro lists all options below each other, as `_entries` reads them."""
    before = os.environ.get("COLUMNS")
    os.environ["COLUMNS"] = _PARSED_WIDTH
    try:
        yield
    finally:
        del os.environ["COLUMNS"]
        if before is not None:
            os.environ["COLUMNS"] = before


def _axes_as_vectors(arguments: Sequence[str]) -> list[str]:
    """The arguments with the up vector as numbers where it was given as an axis.

    >>> _axes_as_vectors(["a.ply", "--up", "-y", "--up=z"])
    ['a.ply', '--up', '0', '-1', '0', '--up', '0', '0', '1']
    """
    found: list[str] = []
    for argument in arguments:
        name, separator, value = argument.partition("=")
        if separator and name == "--up" and _AXIS.fullmatch(value):
            found += ["--up", *_vector(value)]
        elif found and found[-1] == "--up" and _AXIS.fullmatch(argument):
            found += _vector(argument)
        else:
            found.append(argument)
    return found


def _vector(axis: str) -> list[str]:
    numbers = _AXES[axis[-1].lower()]
    return (numbers.replace("1", "-1") if axis.startswith("-") else numbers).split()


def _refuse(complaint: str, command: str, arguments: Sequence[str]) -> NoReturn:
    """Raise what tyro says in its box as one sentence without names of Python."""
    text = " ".join(re.sub(r"\x1b\[[\d;]*m|[╭╮╰╯│─]", " ", complaint).split())
    seek = f"see gaussian-trimmer {command} --help"
    if missing := re.search(r"Missing from [^:]*: (\S+)", text):
        raise InputError(f"'{command}' needs {missing[1].rstrip(',')}; {seek}.")
    if unknown := re.search(r"Unrecognized (?:options|arguments): ([^,\s]+)", text):
        similar = re.search(r"(?:Perhaps you meant|[Ss]imilar[^:]*): +(--[\w.-]+)", text)
        cure = f"did you mean {similar[1]}?" if similar else f"{seek}."
        raise InputError(f"{unknown[1]} is not an option or argument of '{command}'; {cure}")
    spelt = {_name_of(argument) for argument in arguments}
    named = next((name for name in _OPTION.findall(text) if name.lower() in spelt), None)
    if named is None:
        raise InputError(f"These arguments of '{command}' are not understood; {seek}.")
    given = _values_of(named, arguments)
    shown = f"is '{' '.join(given)}'" if given else "has no value"
    raise InputError(f"{named} {shown}; {_wanted(named, text)}.")


def _name_of(argument: str) -> str:
    return argument.split("=")[0].replace("_", "-").lower()


def _values_of(option: str, arguments: Sequence[str]) -> list[str]:
    """What was given to an option."""
    place = next(i for i, argument in enumerate(arguments) if _name_of(argument) == option.lower())
    _, separator, value = arguments[place].partition("=")
    if separator:
        return [value]
    return list(takewhile(lambda text: not text.startswith("--"), arguments[place + 1 :]))


def _wanted(option: str, text: str) -> str:
    """What a value may be, from what tyro says of it."""
    if option == "--up":
        return "it must be three numbers, or an axis such as z or -y"
    if choices := re.search(r"[Ee]xpected one of \(([^)]*)\)", text):
        names = [name.strip(" '") for name in choices[1].split(",")]
        return f"available: {', '.join(filter(None, names))}"
    if number := re.search(r"Expected (\d+) values?", text):
        return f"it takes {number[1]} values with spaces between them" if number[1] != "1" else "it takes one value"
    metavar = text.partition("helptext:")[2]
    if re.search(r"(?:FLOAT|INT|\b[XYZ]\d?) (?:FLOAT|INT|[XYZ]\d?)\b", metavar):
        return "it must be numbers with spaces between them"
    if "FLOAT" in metavar or "to float" in text:
        return "it must be a number"
    return "it must be a whole number" if "INT" in metavar or "ID" in metavar else "that is not possible"


def _help(text: str, kind: type[Any], prog: str, *, everything: bool) -> str:
    """tyro's help as plain text, of all options or of the common ones."""
    head, _, boxes = text.partition("╭")
    usage, _, description = head.partition("\n")
    width = min(shutil.get_terminal_size().columns, _WIDEST_HELP)
    lines = [_plain(usage)]
    for paragraph in description.strip().split("\n\n"):
        lines += ["", _wrapped(paragraph, width)]
    left_out = 0
    for title, entries in _entries(boxes):
        shown = [entry for entry in entries if everything or _is_common(entry[0], kind)]
        left_out += len(entries) - len(shown)
        lines += ["", f"{title}:"] if shown else []
        for entry in shown:
            name, words = _plain_entry(*entry)
            lines += [f"  {name}", *([_wrapped(words, width, _INDENT)] if words else [])]
    if left_out:
        lines += ["", f"There are {left_out} more settings: {prog} {HELP_ALL}"]
    return "\n".join(lines) + "\n"


def _is_common(name: str, kind: type[Any]) -> bool:
    """Whether short help lists an option: the command says which; else all but those of a stage, `--STAGE.NAME`."""
    if not name.startswith("--"):
        return True
    option = _OPTION.findall(name)[0]
    return option in kind.COMMON_OPTIONS if hasattr(kind, "COMMON_OPTIONS") else "." not in option


def _entries(boxes: str) -> Iterator[tuple[str, list[tuple[str, str]]]]:
    """Titles of tyro's boxes with the entries of each: an option or argument, and what is said of it."""
    for box in boxes.split("╭"):
        title, *rows = (row.strip("│") for row in box.split("\n"))
        entries: list[tuple[str, str]] = []
        for row in rows:
            words = row.strip()
            if words.startswith("──"):  # what stands above describes the group
                entries = []
            elif row.startswith("  ") and words and entries:
                entries[-1] = (entries[-1][0], f"{entries[-1][1]} {words}".strip())
            elif words.startswith("-") or (words and not entries) or title.startswith("─ pos"):
                name, _, more = words.partition("  ")
                entries.append((name, more.strip()))
            elif words and not words.startswith("╰"):  # the rest of a long list of choices
                entries[-1] = (entries[-1][0] + words, entries[-1][1])
        yield title.strip("─╮ "), [entry for entry in entries if entry[0] and not entry[0].startswith("╰")]


def _plain_entry(name: str, words: str) -> tuple[str, str]:
    """An entry without what goes without saying: that there is no default, and that a flag is not set."""
    name = re.sub(r"^--up \S.*", "--up X Y Z, or an axis such as z or -y", _plain(name))
    if words.endswith("(default: False)"):
        name = name.partition(",")[0]
    return name, re.sub(r" ?\((?:default: (?:None|False|''|)|repeatable)\)", "", words)


def _plain(words: str) -> str:
    return words.replace("{None}|", "")


def _wrapped(words: str, width: int, indent: int = 0) -> str:
    return textwrap.fill(" ".join(words.split()), width, initial_indent=" " * indent, subsequent_indent=" " * indent)
