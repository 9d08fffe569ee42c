"""What every page of this program has in common: one style, light and dark, and a policy against foreign contents.

Names of files and what they say come from strangers: text reaches a page through `text` alone. The policy in a page's
head lets no script run but the page's own, by its checksum, and a page that stands alone may not use the network.
"""

from __future__ import annotations

import base64
import hashlib
import html
import json
from functools import cache
from importlib.resources import files
from typing import Any

from gaussian_trimmer.errors import printable

SUFFIXES = (".html", ".htm")
"""Endings of names that browsers know as those of pages."""
_MAX_TEXT = 4000
"""Characters of one text of a stranger's that a page shows."""


def document(title: str, body: str, *, style: str = "", script: str = "", stands_alone: bool = True) -> str:
    """A whole page.

    Args:
        title: plain text.
        body: HTML.
        style: CSS beside that of all pages.
        script: JavaScript that runs when the body is there.
        stands_alone: nothing outside the page is needed, so that nothing outside may be loaded; otherwise pictures
            beside the page are shown.
    """
    checksum = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    scripts = f"'sha256-{checksum}'" if script else "'none'"
    policy = [f"script-src {scripts}", "worker-src blob:", "child-src blob:", "base-uri 'none'", "form-action 'none'"]
    if stands_alone:
        policy = ["default-src 'none'", "img-src data:", "style-src 'unsafe-inline'", *policy]
    lines = [
        "<!DOCTYPE html>",
        '<html lang="en"><head><meta charset="utf-8">',
        f'<meta http-equiv="Content-Security-Policy" content="{"; ".join(policy)}">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        '<link rel="icon" href="data:,">',
        f"<title>{text(title)}</title>",
        f"<style>\n{asset('page.css')}{style}</style></head><body>",
        body,
        *([f"<script>{script}</script>"] if script else []),
        "</body></html>",
    ]
    return "\n".join(lines) + "\n"


@cache
def asset(name: str) -> str:
    """The text of a file of this folder's `assets`."""
    return files(__package__).joinpath("assets", name).read_text(encoding="utf-8")


def text(value: object) -> str:
    """Anything as HTML that shows it as plain text, also within quotes of an attribute.

    >>> text("<b>'a' & b</b>")
    '&lt;b&gt;&#x27;a&#x27; &amp; b&lt;/b&gt;'
    """
    return html.escape(printable(str(value), _MAX_TEXT))


def json_block(name: str, value: Any) -> str:
    """An element that holds data for the page's script, which finds it by its name.

    >>> json_block("a", "</script>")
    '<script type="application/json" id="a">"\\\\u003c/script>"</script>'
    """
    data = json.dumps(value, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    return f'<script type="application/json" id="{name}">{data}</script>'
