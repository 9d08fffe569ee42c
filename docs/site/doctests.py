"""Doctests in docstrings are drawn as code; as text, a printed list after a bracket would be read as a link."""

from __future__ import annotations

import re
from typing import Any

from griffe import Extension, Object

_DOCTEST = re.compile(r"(?:^>>> .*\n?(?:^(?!>>> ).+\n?)*)+", re.MULTILINE)


class FencedDoctests(Extension):  # type: ignore[misc]
    """Put a fence around each run of doctest lines, up to the blank line that ends it."""

    def on_object(self, *, obj: Object, **_: Any) -> None:
        """Rewrite the docstring of one module, class, function or attribute."""
        if obj.docstring and ">>> " in obj.docstring.value:
            obj.docstring.value = _DOCTEST.sub(lambda found: _fenced(found[0]), obj.docstring.value)


def _fenced(doctest: str) -> str:
    return f"```pycon\n{doctest.rstrip()}\n```\n"
