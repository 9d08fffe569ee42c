"""What a path is: by its name, by what lies in the folder, and of JSON by how it begins; nothing is read.

Trainings leave their scenes in these places:

- Inria's code and those built on it, as Gaussian Grouping: `point_cloud/iteration_<i>/point_cloud.ply`
- nerfstudio: an export, `splat.ply` or `point_cloud.ply`, or else `nerfstudio_models/step-<i>.ckpt`
- gaussian-splatting-lightning: `checkpoints/epoch=<e>-step=<i>.ckpt`
- gsplat's trainer: `ckpts/ckpt_<i>_rank0.pt`; Inria's checkpoints, COB-GS's and NG-GS's: `chkpnt<i>.pth`
- an unbundled SOG: `meta.json` and its textures; a streamed one: `lod-meta.json`
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from glob import escape
from pathlib import Path
from typing import Literal

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.io.reading import is_file, is_folder

Kind = Literal["folder", "results", "splats", "torch", "array", "marks", "project", "cameras", "unknown"]
STREAMED = "lod-meta.json"
"""The format with levels of detail."""
FORMATS = {
    ".ply": "ply",
    ".compressed.ply": "compressed_ply",
    ".splat": "splat",
    ".spz": "spz",
    ".sog": "sog",
    ".glb": "glb",
}
"""Ends of names, of which the longest wins -> module with `read(path) -> Gaussians`, whose values are not yet checked,
`write(gaussians, path) -> None` and perhaps `write_selected(gaussians, rows, appended, path) -> None`."""
READ_ONLY = {
    ".gltf": "glb",
    "meta.json": "sog",
    STREAMED: "streamed_sog",
    ".ckpt": "checkpoints",
    ".pth": "checkpoints",
    ".pt": "checkpoints",
}
"""Formats that can be read but not written."""
_WRITTEN_INSTEAD = {"meta.json": ".sog", ".gltf": ".glb"}
TORCH_SUFFIXES, TEXT_SUFFIXES = (".pt", ".pth"), (".txt", ".csv")
SELECTION_SUFFIXES = (".npy", ".npz", *TEXT_SUFFIXES, ".json", *TORCH_SUFFIXES)
"""Ends of names of selections, beside those of splats."""
MARKS, PROJECT = "selection marks", "gaussian-trimmer project"
"""What files of marks, and projects of the app, say of their content."""
_ITERATION_NAME = re.compile(r"iteration_(?:[a-z]+_)?(\d{1,12})")
_SPLAT_NAMES = ("point_cloud.ply", "scene_point_cloud.ply", "splat.ply")
_CHECKPOINT_FOLDERS = ("nerfstudio_models", "ckpts", "checkpoints")
_CHECKPOINT_NAME = re.compile(r"(?:step-|chkpnt|ckpt_|epoch=\d{1,12}-step=)(\d{1,12})(?:_rank0)?\.(?:ckpt|pth|pt)")
_COLMAP_FOLDERS, _COLMAP_SUFFIXES = (Path(), Path("sparse/0"), Path("sparse")), (".bin", ".txt")
_CAMERA_DOCUMENTS = ("transforms.json", "cameras.json")
_NUMBERS = re.compile(rb"\s*\[\s*[-\d.tf\]]")
"""How a JSON list of numbers or booleans begins."""
_LISTED = 12


@dataclass(frozen=True)
class MethodFile:
    """One kind of file that a segmentation method writes below the folder of a training."""

    method: str
    pattern: str
    """Where it lies; `{object}` stands for the name that the user gave the object there."""
    needs: str = ""
    """Option that the command needs beside."""
    own_scene: bool = False
    """Whether its rows are not those of the training's scene, but of the Gaussians that it holds itself."""


_ITERATION = "point_cloud/iteration_*/"
BY_ID = "--set selection.object-id=ID"
"""Option that a file of several objects needs beside."""
METHOD_FILES = (
    MethodFile("SAGA", "segmentation_res/{object}.pt"),
    MethodFile("SAGA, version 1", "final_mask.pt"),
    MethodFile("SA3D-GS", _ITERATION + "seg_point_cloud.ply"),
    MethodFile("SA3D-GS", "seg_point_cloud.ply"),
    MethodFile("SA3D-GS", _ITERATION + "seg_point_cloud_*.npy"),
    MethodFile("Gaussian Grouping, Gaga or Unified-Lift", _ITERATION + "classifier.pth", BY_ID),
    MethodFile("Gaussian Grouping, Gaga or Unified-Lift", "classifier.pth", BY_ID),
    MethodFile("OpenGaussian or InstanceGaussian", "cluster_lang.npz", BY_ID),
    MethodFile("InstanceGaussian", "cluster_result.pt", BY_ID),
    MethodFile("SAGD", _ITERATION + "point_cloud_seg.ply"),
    MethodFile("SAGD", "point_cloud_seg.ply"),
    MethodFile("OmniSeg3D-GS", _ITERATION + "debug_{object}_*.ply"),
    MethodFile("OmniSeg3D-GS", "debug_{object}_*.ply"),
    MethodFile("FlashSplat", "used_count/*_objnum_*.pth"),
    MethodFile("FlashSplat", "train/ours_*/used_count/*_objnum_*.pth"),
    MethodFile("Gradient-Driven Segmentation", "mask3d.pth"),
    MethodFile("COB-GS or NG-GS", "masks/{object}/chkpnt*.pth", own_scene=True),
    MethodFile("GaussianCut", "graphcut_{object}/remove_source.pt"),
    MethodFile("THGS", "nag-l*.pt", BY_ID),
    MethodFile("LUDVIG", "features.npy", "--set selection.threshold=T"),
    MethodFile("Trace3D", "objects/{object}_gaus_mask.pt"),
)
"""In the order in which they are looked for."""


def identify(path: str | Path) -> Identity:
    """Return what a path is; it need not be there.

    >>> identify("scene.sog").kind, identify("mask.npy").kind, identify("notes.md").kind
    ('splats', 'array', 'unknown')
    """
    path = Path(path)
    return Identity(path, _kind(path))


@dataclass(frozen=True)
class Identity:
    """A path and what it is, from which follow the files that it can stand for."""

    path: Path
    kind: Kind
    """torch: a scene or a selection, which only its content tells; array: of numbers, in any container."""

    @property
    def may_be_scene(self) -> bool:
        """Whether a scene can be read from it."""
        return self.kind in ("splats", "torch", "folder", "results")

    @property
    def scene(self) -> Path:
        """The splat file: itself, or in the folder of a training that of the latest iteration.

        Raises:
            InputError: the folder holds no splat file, or several that could be meant; or it is no file.
        """
        if self.kind in ("folder", "results"):
            return _latest_splats(self.path)
        if self.kind == "unknown":
            _refuse_missing(self.path)
        return self.path

    @property
    def selections(self) -> list[tuple[Path, MethodFile]]:
        """The files that methods left in the folder, with what they are; of a method's checkpoints the latest."""
        found = []
        for kind in METHOD_FILES:
            paths = [path for path in sorted(self.path.glob(kind.pattern.replace("{object}", "*"))) if path.is_file()]
            found += [(path, kind) for path in (_latest(paths) if kind.own_scene else paths)]
        return found

    @property
    def selection(self) -> Path:
        """The selection: itself, or the one file in the folder that a method left as its own.

        Raises:
            InputError: there is none, or there are several.
        """
        if self.kind not in ("folder", "results"):
            return self.path
        found = [path for path, _ in self.selections] or _latest(self.path.glob("chkpnt*.pth"))
        if len(found) == 1:
            return found[0]
        if not found:
            raise InputError(
                f"The folder '{self.path}' holds no file of a known segmentation method; name the selection itself "
                "(docs/methods.md lists what methods write)."
            )
        names = ", ".join(str(path.relative_to(self.path)) for path in found[:_LISTED])
        raise InputError(f"The folder '{self.path}' holds several selections; give one of them: {names}.")

    @property
    def scene_and_selection(self) -> Path:
        """What a path means that is given as scene and selection: a method's own scene in the folder, or itself."""
        found = [path for path, kind in self.selections if kind.own_scene] if self.kind == "folder" else []
        return found[0] if len(found) == 1 else self.path

    @property
    def cameras(self) -> Path:
        """The JSON file, or the images file of a COLMAP model, of the file or folder.

        Raises:
            InputError: there is none, or there are several that could be meant.
        """
        path = self.path
        if is_file(path):
            if path.suffix.lower() == ".json":
                return path
            if path.stem in ("cameras", "images") and path.suffix in _COLMAP_SUFFIXES:
                return identify(path.parent).cameras
            raise InputError(f"'{path}' is not a camera file; give a COLMAP folder, a transforms.json or cameras.json.")
        if not is_folder(path):
            raise InputError(f"There is no file or folder '{path}' to read cameras from.")
        models = [
            path / folder / f"images{suffix}"
            for folder in _COLMAP_FOLDERS
            for suffix in _COLMAP_SUFFIXES
            if all((path / folder / f"{stem}{suffix}").is_file() for stem in ("cameras", "images"))
        ]
        # Binary and text twins of one COLMAP model agree; files of different kinds may use different coordinates.
        found = models[:1] + [path / name for name in _CAMERA_DOCUMENTS if (path / name).is_file()]
        if len(found) > 1:
            names = ", ".join(str(candidate.relative_to(path)) for candidate in found)
            raise InputError(
                f"'{path}' holds several sets of cameras ({names}); give the one that the splat was made from."
            )
        if not found:
            raise InputError(
                f"'{path}' holds no cameras: neither cameras and images (.bin or .txt) of a COLMAP model, there or in "
                "sparse/0 or sparse, nor a transforms.json or cameras.json."
            )
        return found[0]


def _refuse_missing(path: Path) -> None:
    """Refuse a scene of unknown kind that is no file, and say which file may be meant."""
    if path.exists() and not is_file(path):
        raise InputError(f"'{path}' is a device or a pipe; save what comes from it as a file, such as scene.ply.")
    if not path.exists():
        near = [str(other) for other in sorted(path.parent.glob(f"{escape(path.name)}.*")) if _known_suffix(other.name)]
        raise InputError(f"There is no file '{path}'" + (f"; did you mean '{near[0]}'?" if near else "."))


def format_suffix(path: str | Path) -> str:
    """Return the known suffix that a file's name ends with, of a format that can be read.

    Raises:
        InputError: the name ends with no known suffix.

    >>> format_suffix("Scene.PLY")
    '.ply'
    """
    name = Path(path).name
    if suffix := _known_suffix(name):
        return suffix
    if name.lower().endswith(".ksplat"):
        raise InputError(f"'{name}' is in a format that went; convert it: splat-transform {name} scene.ply.")
    hint = " A selection is given after its scene." if name.lower().endswith(SELECTION_SUFFIXES) else ""
    raise InputError(f"'{name}' is not in a known splat format; known endings: {', '.join(FORMATS | READ_ONLY)}.{hint}")


def written_suffix(path: str | Path) -> str:
    """Return the suffix in which results of a scene file are written: its own, or the nearest that can be.

    Raises:
        InputError: the name ends with no known suffix.

    >>> written_suffix("a.spz"), written_suffix("step-000029999.ckpt")
    ('.spz', '.ply')
    """
    suffix = format_suffix(path)
    return suffix if suffix in FORMATS else _WRITTEN_INSTEAD.get(suffix, ".ply")


def is_named(name: str, suffix: str) -> bool:
    """Return whether a file's name ends with a suffix, or is equal to one that does not begin with a dot.

    >>> is_named("a.SOG", ".sog"), is_named("Meta.json", "meta.json"), is_named("lod-meta.json", "meta.json")
    (True, True, False)
    """
    return name.lower().endswith(suffix) if suffix.startswith(".") else name.lower() == suffix


def _known_suffix(name: str) -> str | None:
    return max((suffix for suffix in FORMATS | READ_ONLY if is_named(name, suffix)), key=len, default=None)


def _kind(path: Path) -> Kind:
    suffix = path.suffix.lower()
    if is_folder(path):
        return "results" if is_file(path / "labels.npz") and is_file(path / "report.json") else "folder"
    if suffix in TORCH_SUFFIXES:
        return "torch"
    if _known_suffix(path.name):
        return "splats"
    if path.stem in ("cameras", "images") and suffix in _COLMAP_SUFFIXES:
        return "cameras"
    if suffix == ".json":
        return _kind_of_json(path)
    return "array" if suffix in SELECTION_SUFFIXES else "unknown"


def _kind_of_json(path: Path) -> Kind:
    if not is_file(path):
        return "cameras"
    with path.open("rb") as file:
        begin = file.read(256)
    if f'"content": "{PROJECT}"'.encode() in begin:  # first, since there are marks in it
        return "project"
    if f'"content": "{MARKS}"'.encode() in begin:
        return "marks"
    return "array" if _NUMBERS.match(begin) else "cameras"


def _latest_splats(folder: Path) -> Path:
    """Return the splat file of the latest iteration in a training's folder, or the only one that a folder holds."""
    if (folder / STREAMED).is_file():
        return folder / STREAMED
    for place in (folder / "point_cloud", folder):
        iterations = [
            (int(found[1]), path) for path in place.glob("*") if (found := _ITERATION_NAME.fullmatch(path.name))
        ]
        for _, path in sorted(iterations, reverse=True):
            for name in _SPLAT_NAMES:
                if (path / name).is_file():
                    return path / name
    named = [folder / name for name in _SPLAT_NAMES if (folder / name).is_file()]
    if len(named) == 1:
        return named[0]
    if (folder / "meta.json").is_file() and any(folder.glob("*.webp")):
        return folder / "meta.json"
    splats = named or [
        path for path in folder.glob("*") if path.name.lower().endswith(tuple(FORMATS)) and path.is_file()
    ]
    if len(splats) == 1:
        return splats[0]
    if splats:
        names = ", ".join(sorted(path.name for path in splats)[:8])
        raise InputError(f"The folder '{folder}' holds several splat files ({names}); give one of them.")
    for place in (*(folder / name for name in _CHECKPOINT_FOLDERS), folder):
        steps = [(int(found[1]), path) for path in place.glob("*") if (found := _CHECKPOINT_NAME.fullmatch(path.name))]
        if steps:
            return max(steps)[1]
    raise InputError(
        f"The folder '{folder}' holds no splat file, no point_cloud/iteration_* and no checkpoint such as "
        f"{_CHECKPOINT_FOLDERS[0]}/step-*.ckpt; give the folder of a training or a splat file."
    )


def _latest(paths: Iterable[Path]) -> list[Path]:
    """Return, of checkpoints in the same folder, the one of the latest iteration."""
    latest: dict[Path, Path] = {}
    for path in sorted(paths, key=lambda path: (len(path.name), path.name)):
        latest[path.parent] = path
    return list(latest.values())
