"""The documentation does what it says: its Python runs, its commands exist, its figures are made, its links lead."""

import importlib.util
import logging
import re
import shlex
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
import toy
from dataset_layouts import save_capture, write
from test_streamed_sog import streamed

import gaussian_trimmer as gt
from gaussian_trimmer import cli, formats
from gaussian_trimmer.gaussians import sigmoid

ROOT = Path(__file__).parents[1]
PAGES = sorted([*ROOT.glob("docs/**/*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md"])
NOT_RUN = {
    "sam.md": "needs a model", "sam2.md": "needs a model",
    "selecting.md": "names views and pixels of a capture",
}  # fmt: skip
"""Pages whose Python is only compiled."""
STANDALONE = ("README.md", "researchers.md", "robotics.md", "service.md")
"""Pages whose every block runs as it is copied, in a folder with the files that it names."""
_BLOCK = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)
_COMMAND = re.compile(r"gaussian-trimmer (?!\[)[^`\n#&]+")
_LINK = re.compile(r"\]\(([^)\s]+)\)")


def name(page):
    return page.relative_to(ROOT).as_posix()


def blocks(page):
    return _BLOCK.findall(page.read_text(encoding="utf-8"))


class Tensor(np.ndarray):
    """An array with what examples ask of PyTorch's tensors."""

    def detach(self):
        return self

    def cpu(self):
        return self

    def float(self):
        return self

    def numpy(self):
        return self


class Torch:
    @staticmethod
    def cat(tensors, dim):
        return np.concatenate(tensors, axis=dim).view(Tensor)


def tensor(array):
    return np.ascontiguousarray(array).view(Tensor)


@pytest.fixture(scope="module")
def workplace(tmp_path_factory):
    """The files and names that pages take for granted."""
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
    (folder / "apartment").mkdir()
    streamed(folder / "apartment")
    return folder


@pytest.fixture
def names(workplace, monkeypatch):
    monkeypatch.chdir(workplace)
    trim = gt.trim  # with small views: what pages ask for beside is kept
    monkeypatch.setattr(gt, "trim", lambda *given, **named: trim(*given, config=toy.small_config(up=None), **named))
    together = gt.trim_objects
    monkeypatch.setattr(
        gt, "trim_objects", lambda *given, **named: together(*given, config=toy.small_config(up=None), **named)
    )
    shutil.rmtree("trimmed", ignore_errors=True)
    scene, truth = toy.ball_on_floor()
    rough = toy.dilated(scene, truth)
    cameras = gt.read_cameras("sparse/0")
    centre = scene.means[truth].mean(axis=0).astype(np.float64)
    pixel = np.round(cameras.cameras[0].project(centre[None])[0][0]).astype(int)
    sh = np.concatenate([scene.sh_dc[:, None], scene.sh_rest.transpose(0, 2, 1)], axis=1)
    splats = {
        "means": tensor(scene.means), "quats": tensor(scene.quaternions), "sh0": tensor(sh[:, :1]),
        "shN": tensor(sh[:, 1:]), "scales": tensor(scene.log_scales), "opacities": tensor(scene.opacity_logits),
    }  # fmt: skip

    class Model:
        get_xyz, get_rotation, get_features = map(tensor, (scene.means, scene.quaternions, sh))
        get_scaling, get_opacity = tensor(np.exp(scene.log_scales)), tensor(sigmoid(scene.opacity_logits))

    with toy.one_thread():
        result = gt.trim(scene, rough, up="z")
        yield {
            "gt": gt, "np": np, "Path": Path, "logging": logging, "torch": Torch, "splats": splats, "model": Model,
            "scene": scene, "rough": rough, "result": result, "camera": cameras.cameras[0], "up": toy.UP,
            "formats": formats, "pixel": tuple(pixel.tolist()),
        }  # fmt: skip


@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page)], ids=name)
def test_python_of_the_pages_runs(page, names):
    for number, block in enumerate(blocks(page)):
        code = compile(block.replace("[(312, 218)]", "[pixel]"), f"{name(page)}, block {number + 1}", "exec")
        if page.name not in NOT_RUN:
            exec(code, {"__name__": "copied"} if page.name in STANDALONE else names)


def test_no_exception_is_left_over():
    assert NOT_RUN.keys() | set(STANDALONE) <= {page.name for page in PAGES if blocks(page)}


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
    two = " ".join(words[:2])
    known, arguments = (two, words[2:]) if two in cli.COMMANDS else (words[0], words[1:])
    assert known in cli.COMMANDS, f"there is no command '{known}'"
    if arguments and not {"--help", "--help-all"}.intersection(arguments):  # else it is only named
        cli._parse(known, arguments)


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_links_lead_to_files(page):
    for link in _LINK.findall(page.read_text(encoding="utf-8")):
        target = link.partition("#")[0]
        if target and "://" not in target:
            assert (page.parent / target).exists(), link


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


@pytest.mark.needs("mkdocs")
def test_the_reference_has_every_module():
    text = "".join(load(ROOT / "docs" / "site" / "hooks.py").reference_pages().values())
    for path in (ROOT / "src" / "gaussian_trimmer").rglob("*.py"):
        module = ".".join(path.relative_to(ROOT / "src").with_suffix("").parts).removesuffix(".__init__")
        assert path.name == "__main__.py" or f"::: {module}\n" in text, module
