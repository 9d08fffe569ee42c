"""Files about the project: one version everywhere, a dated changelog, and links that lead somewhere."""

import re
import tomllib
from pathlib import Path

import pytest

from gaussian_trimmer._version import __version__

ROOT = Path(__file__).parents[1]
pytestmark = pytest.mark.skipif(not (ROOT / "CITATION.cff").is_file(), reason="the project's files are not here")


def test_the_citation_names_this_version_and_its_day():
    citation = (ROOT / "CITATION.cff").read_text()
    assert f"\nversion: {__version__}\n" in citation
    (day,) = re.findall(r"^date-released: (\d{4}-\d\d-\d\d)$", citation, re.MULTILINE)
    assert f"\n## {__version__} - {day}\n" in (ROOT / "CHANGELOG.md").read_text()


def test_every_version_in_the_changelog_has_a_day_but_the_next():
    titles = re.findall(r"^## (.*)$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert titles[0] == "Unreleased"
    assert all(re.fullmatch(r"\d+\.\d+\.\d+ - \d{4}-\d\d-\d\d", title) for title in titles[1:])


def test_the_page_on_a_package_index_names_every_extra_and_links_to_no_file():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    page = project["readme"]["text"]
    assert not re.search(r"\]\((?!https://)", page)
    assert all(f"`{extra}`" in page for extra in project["optional-dependencies"].keys() - {"test", "dev", "docs"})


def test_links_of_the_pages_lead_to_files():
    for page in (*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md"), *(ROOT / "benchmarks").glob("*/*.md")):
        for target in re.findall(r"\]\(([^)#]*)(?:#[^)]*)?\)", page.read_text()):
            if target and not target.startswith("https://"):
                assert (page.parent / target).exists(), f"{page.name} links to {target}"
