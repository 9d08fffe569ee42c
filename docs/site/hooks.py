"""What the site needs besides its pages: the API reference from the docstrings, and links into the source.

Every folder and file of the package becomes a page of the reference, so that nothing is listed by hand. Links of a page
to a source file lead to its place in the reference; those to other files of the repository, which the site does not
have, become plain text. Equations become MathML, which browsers draw without a script.
"""

from __future__ import annotations

import html
import re
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "src" / "gaussian_trimmer"
FILES_PAGE = "Modules of one file"
_EQUATION = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)
_OUTWARD = re.compile(r"\[((?:[^\[\]]|\[[^\]]*\])*)\]\(((?:\.\./)+)([^)#]+)(#[^)]*)?\)")


def on_config(config: Any) -> Any:
    """List the pages of the reference in the navigation."""
    for section in config["nav"]:
        if "Reference" in section:
            section["Reference"] = list(reference_pages())
    return config


def on_files(files: Files, config: Any) -> Files:
    """Add the pages of the reference."""
    for path, text in reference_pages().items():
        files.append(File.generated(config, path, content=text))
    return files


def reference_pages() -> dict[str, str]:
    """The pages of the reference by path: one for each folder of the package, one for the files beside them."""
    rooms = sorted(path.name for path in SOURCE.iterdir() if (path / "__init__.py").is_file())
    listing = "\n".join(f"- [{room}]({room}.md): {_summary(SOURCE / room / '__init__.py')}" for room in rooms)
    head = "# Reference\n\nMade from the docstrings, a page for each folder of the package.\n\n"
    pages = {"reference/index.md": f"{head}{listing}\n- [{FILES_PAGE}](files.md)\n"}
    pages |= {f"reference/{room}.md": _page(room, sorted((SOURCE / room).rglob("*.py"))) for room in rooms}
    pages["reference/files.md"] = _page(FILES_PAGE, sorted(SOURCE.glob("*.py")))
    return pages


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Lead links to source files into the reference, and drop those to files that the site does not have."""
    return _OUTWARD.sub(lambda match: _inward(match, Path(page.file.src_uri).parent), markdown)


def on_page_content(content: str, **_: Any) -> str:
    """Draw the equations of a page."""
    return _EQUATION.sub(lambda match: _mathml(html.unescape(match[2]), inline=match[1] == "span"), content)


def _mathml(tex: str, *, inline: bool) -> str:
    return convert(tex, display="inline" if inline else "block")


def _inward(match: re.Match[str], folder: Path) -> str:
    text, up, path = match[1], match[2], match[3]
    place = (ROOT / "docs" / folder / up / path).resolve()
    if place.is_relative_to(ROOT / "docs"):
        return match[0]
    if place.suffix == ".py" and place.is_relative_to(SOURCE):
        return f"[{text}][{_module(place)}]"
    return text


def _page(title: str, files: list[Path]) -> str:
    modules = "\n\n".join(f"::: {_module(path)}" for path in files if path.name != "__main__.py")
    return f"# {title}\n\n{modules}\n"


def _module(path: Path) -> str:
    parts = path.relative_to(SOURCE.parent).with_suffix("").parts
    return ".".join(part for part in parts if part != "__init__")


def _summary(path: Path) -> str:
    """The first line of a module's docstring."""
    return path.read_text(encoding="utf-8").split('"""')[1].splitlines()[0]
