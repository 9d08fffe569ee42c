"""What every page of this program has in common: one style, light and dark, and a policy against foreign contents.

Names of files and what they say come from strangers: what a template is given is escaped unless it is `Markup`. The
policy in a page's head lets no script run but the page's own, by its checksum, and a page that stands alone may not use
the network.
"""

from __future__ import annotations

import base64
import hashlib
import json
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from gaussian_trimmer.errors import printable

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup

_MAX_TEXT = 4000
"""Characters of one text of a stranger's that a page shows."""


def document(title: str, body: str, *, style: str = "", script: str = "", stands_alone: bool = True) -> str:
    """Return a whole page.

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
    policy = [f"script-src {scripts}", "base-uri 'none'", "form-action 'none'"]
    if stands_alone:
        policy = ["default-src 'none'", "img-src data:", "style-src 'unsafe-inline'", *policy]
    page = render_page(
        "page.html",
        title=title,
        policy="; ".join(policy),
        style=as_markup(asset("page.css") + style),
        body=as_markup(body),
        script=as_markup(script),
    )
    return str(page)


def render_page(template: str, **values: Any) -> Markup:
    """Return a template of `assets` with values, all of which are shown as plain text unless they are `Markup`."""
    return as_markup(_environment().get_template(template).render(values))


@cache
def _environment() -> Environment:
    from jinja2 import Environment, FunctionLoader, StrictUndefined
    from markupsafe import Markup

    return Environment(
        loader=FunctionLoader(asset),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        finalize=lambda value: value if isinstance(value, Markup) else printable(str(value), _MAX_TEXT),
    )


@cache
def asset(name: str) -> str:
    """Return the text of a file of this folder's `assets`."""
    return files(__package__).joinpath("assets", name).read_text(encoding="utf-8")


def as_markup(html: str) -> Markup:
    """Mark HTML of this program's own, or what needs no escaping, such as base 64: templates take it as it is."""
    from markupsafe import Markup

    return Markup(html)


def text(value: object) -> str:
    """Return anything as HTML that shows it as plain text, also within quotes of an attribute.

    >>> text("<b>'a' & b</b>")
    '&lt;b&gt;&#39;a&#39; &amp; b&lt;/b&gt;'
    """
    from markupsafe import escape

    return str(escape(printable(str(value), _MAX_TEXT)))


def json_block(name: str, value: Any) -> Markup:
    """Return an element that holds data for the page's script, which finds it by its name.

    >>> str(json_block("a", "</script>"))
    '<script type="application/json" id="a">"\\\\u003c/script>"</script>'
    """
    data = json.dumps(value, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    return as_markup(f'<script type="application/json" id="{name}">{data}</script>')
