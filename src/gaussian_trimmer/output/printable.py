"""Text from files of strangers, made fit for a terminal."""

from __future__ import annotations

import sys

_HEAD, _TAIL = 900, 300
"""Characters that are kept of a text that is too long: what is wrong stands first, and the cure last."""


def printable(text: str) -> str:
    r"""Text with everything that could steer a terminal written out, and its middle left out if it is very long.

    >>> printable("name \x1b[31m of \u202e a column")
    'name \\x1b[31m of \\u202e a column'
    >>> len(printable("a" * 20_000)) < 1500
    True
    """
    if len(text) > _HEAD + _TAIL:
        text = f"{text[:_HEAD]} [{len(text) - _HEAD - _TAIL} characters left out] {text[-_TAIL:]}"
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


def write_any_character() -> None:
    """Have characters that the terminal's encoding lacks written as escapes; they would be errors otherwise."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure") and stream.errors == "strict":
            stream.reconfigure(errors="backslashreplace")
