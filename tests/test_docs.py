"""The documentation does what it says: its Python runs, its commands exist, its figures are made, its links lead."""

import functools
import importlib.util
import re
import shlex
import shutil
import tomllib
from pathlib import Path

import cv2
import numpy as np
import pytest
import toy
from dataset_layouts import save_capture, write
from test_streamed_sog import streamed

import gaussian_trimmer as gt
from gaussian_trimmer import formats
from gaussian_trimmer.commands import COMMANDS, command_in, parser_of

ROOT = Path(__file__).parents[1]
PAGES = sorted([*ROOT.glob("docs/**/*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md"])
NOT_RUN = {
    "sam.md": "needs a model",
}  # fmt: skip
"""Pages whose Python is compiled, but not run."""
_BLOCK = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)
_COMMAND = re.compile(r"gaussian-trimmer (?!\[)[^`\n#&]+")
_LINK = re.compile(r"\]\(([^)\s]+)\)")


def name(page):
    return page.relative_to(ROOT).as_posix()


def blocks(page):
    return _BLOCK.findall(page.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def workplace(tmp_path_factory):
    """A folder with the files that pages name."""
    folder = tmp_path_factory.mktemp("docs")
    masks, _ = save_capture(folder, [f"IMG_{i}.png" for i in range(5)], "rough.npy")
    for view, mask in masks.items():
        write(folder / "masks" / view, mask)
    (folder / "manifest.csv").write_text("scene,selection\nscene.ply,rough.npy\n", encoding="utf-8")
    (folder / "sparse" / "0").mkdir(parents=True)
    (folder / "cameras.json").rename(folder / "sparse" / "0" / "cameras.json")
    scene = formats.read(folder / "scene.ply")
    np.save(folder / "labels.npy", np.load(folder / "rough.npy").astype(np.int64))
    formats.write(scene, folder / "scene.spz")
    formats.write(scene.select(np.load(folder / "rough.npy")), folder / "object.ply")
    (folder / "apartment").mkdir()
    streamed(folder / "apartment")
    return folder


@pytest.fixture
def copied(workplace, monkeypatch):
    """Names as they are where a page is copied, with small views in every trim."""
    monkeypatch.chdir(workplace)
    shutil.rmtree("trimmed", ignore_errors=True)
    for name in ("trim", "trim_objects"):
        small = functools.partial(getattr(gt, name), config=toy.small_config(up=None))
        monkeypatch.setattr(gt, name, small)
    with toy.one_thread():
        yield {"__name__": "copied"}


@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page)], ids=name)
def test_python_of_the_pages_runs_when_copied(page, copied):
    for number, block in enumerate(blocks(page)):
        code = compile(block, f"{name(page)}, block {number + 1}", "exec")
        if page.name not in NOT_RUN:
            exec(code, copied)


def commands():
    texts = {name(page): page.read_text(encoding="utf-8").replace("\\\n", " ") for page in PAGES}
    given = [(command.strip(), page) for page, text in texts.items() for command in _COMMAND.findall(text)]
    # Two commands of the same words and options differ in values alone.
    found = {" ".join(word for word in command.split() if word.isalpha() or word[:2] == "--"): (command, page)
             for command, page in given}  # fmt: skip
    return [pytest.param(command, id=f"{page}: {command}") for command, page in sorted(found.values())]


@pytest.mark.parametrize("command", commands())
def test_commands_of_the_pages_are_understood(command):
    words = shlex.split(command.rstrip("| )"))[1:]
    known, arguments = command_in(words)
    assert known in COMMANDS, f"there is no command '{known}'"
    if arguments and not {"--help", "--help-all"}.intersection(arguments):  # else it is only named
        parser_of(known).parse(arguments)


@pytest.mark.parametrize("page", [*PAGES, *ROOT.glob("benchmarks/*/*.md"), ROOT / "CHANGELOG.md"], ids=name)
def test_links_lead_to_files(page):
    for link in _LINK.findall(page.read_text(encoding="utf-8")):
        target = link.partition("#")[0]
        if target and "://" not in target:
            assert (page.parent / target).exists(), link


def test_one_version_everywhere_and_a_day_for_each_in_the_changelog():
    citation, changes = ((ROOT / name).read_text(encoding="utf-8") for name in ("CITATION.cff", "CHANGELOG.md"))
    assert f"\nversion: {gt.__version__}\n" in citation
    (day,) = re.findall(r"^date-released: (\d{4}-\d\d-\d\d)$", citation, re.MULTILINE)
    assert f"\n## {gt.__version__} - {day}\n" in changes
    unreleased, *titles = re.findall(r"^## (.*)$", changes, re.MULTILINE)
    assert unreleased == "Unreleased"
    assert all(re.fullmatch(r"\d+\.\d+\.\d+ - \d{4}-\d\d-\d\d", title) for title in titles)


def test_the_page_on_a_package_index_names_every_extra_and_links_to_no_file():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    page = project["readme"]["text"]
    assert not re.search(r"\]\((?!https://)", page)
    assert all(f"`{extra}`" in page for extra in project["optional-dependencies"].keys() - {"test", "dev", "docs"})


def test_every_page_is_in_the_navigation():
    text = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    for page in ROOT.glob("docs/**/*.md"):
        assert f": {page.relative_to(ROOT / 'docs').as_posix()}\n" in text, page


def load(path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.slow
def test_the_figures_of_the_stages_are_made():
    figures = load(ROOT / "docs" / "site" / "figures.py").figures(size=96)
    text = (ROOT / "docs" / "stages.md").read_text(encoding="utf-8")
    assert {f"images/stages/{figure}" for figure in figures} == set(re.findall(r"\((images/stages/[^)]+)\)", text))
    for figure, picture in figures.items():
        assert picture.ndim == 3 and picture.std() > 10, figure
        stored = cv2.imread(str(ROOT / "docs" / "images" / "stages" / figure))
        assert stored.shape[1] >= 600


@pytest.mark.slow
def test_the_pictures_of_the_walk_show_what_its_commands_do(tmp_path):
    """Up to what another processor rounds in another way; the counts over the rows are the same."""
    walk = load(ROOT / "docs" / "site" / "walk.py")
    walk.main(tmp_path)
    counts = slice(12, 24)  # the line above the first row
    for path in tmp_path.glob("*.jpg"):
        now, shown = (cv2.imread(str(file)).astype(int) for file in (path, walk.FOLDER / path.name))
        assert now.shape == shown.shape and np.abs(now - shown).mean() < 2, path.name
        if path.name != "views.jpg":
            assert np.abs(now - shown)[counts].max() < 60, f"other counts in {path.name}: python docs/site/pictures.py"


@pytest.mark.needs("mkdocs", "latex2mathml")
def test_the_reference_has_every_module():
    text = "".join(load(ROOT / "docs" / "site" / "hooks.py").reference_pages().values())
    for path in (ROOT / "src" / "gaussian_trimmer").rglob("*.py"):
        module = ".".join(path.relative_to(ROOT / "src").with_suffix("").parts).removesuffix(".__init__")
        assert path.name == "__main__.py" or f"::: {module}\n" in text, module
