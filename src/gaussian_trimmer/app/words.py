"""The app's words for what the command line's options do: messages are made once, with the options in them."""

from __future__ import annotations

import re

_WORDS = (
    (r"--overwrite, or in Python overwrite=True", "'Replace' beside 'Earlier results'"),
    (r"give --up (-?)([xyz])\b", lambda said: f"choose {said[1] or '+'}{said[2].upper()} at 'Up is'"),
    (r"give --up [-\d. ]+\d", "use 'Up by 3 points' on the ground"),
    (r"cameras of their pictures: --cameras PATH", "cameras of their pictures; give them beside 'Scene'"),
    (r"a --box around it may do better", "drag 'Tolerance', or draw around it"),
    (r"--with-what-stands-on-it discards (it|them), too", r"'Take along what stands on it' in 'Options' takes \1 out"),
    (r"'[^']*[/\\]files[/\\][0-9a-f]{16}[/\\]([^'/\\]+)'", r"'\1'"),
    (r", or allow it with --trust-paths", " in the file"),
)
"""Patterns of what messages say, and what the app says in its place; files that were dropped have their own names."""
_OPTION = re.compile(r"[;:,] (?:(?!gaussian-trimmer |pip )[^;:,])*(?<![\w/'-])--[a-z][a-z-]*(?!\w).*?(?:\.(?=\s|$)|$)")
"""A clause that names an option, and the rest of its sentence."""
_ELSEWHERE = "; the app cannot choose this: make the selection with 'gaussian-trimmer select', and load it here."


def in_app(text: str) -> str:
    """Return a message in the app's words: its controls in place of options, of which none is left.

    A cure that the app does not have is the command line's; whole commands stay.

    >>> in_app("The up vector is a guess. If the views are upside down, give --up -z.")
    "The up vector is a guess. If the views are upside down, choose -Z at 'Up is'."
    >>> in_app("'a.npy' holds scores; choose with --set selection.threshold=VALUE. More.")[:49]
    "'a.npy' holds scores; the app cannot choose this:"
    """
    for pattern, words in _WORDS:
        text = re.sub(pattern, words, text)
    return _OPTION.sub(_ELSEWHERE, text)
