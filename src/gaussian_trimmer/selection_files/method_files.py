"""Where segmentation methods leave what they select, below the folder of a training, and what else their files need."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from gaussian_trimmer.errors import InputError

_LISTED = 12


@dataclass(frozen=True)
class MethodFile:
    """One kind of file that a method writes."""

    method: str
    pattern: str
    """Where it lies; `{object}` stands for the name that the user gave the object there."""
    needs: str = ""
    """Option that the command needs beside."""
    own_scene: bool = False
    """Whether its rows are not those of the training's scene, but of the Gaussians that it holds itself."""


_ITERATION = "point_cloud/iteration_*/"
_ID = "--selection.object-id ID"
METHOD_FILES = (
    MethodFile("SAGA", "segmentation_res/{object}.pt"),
    MethodFile("SAGA, version 1", "final_mask.pt"),
    MethodFile("SA3D-GS", _ITERATION + "seg_point_cloud.ply"),
    MethodFile("SA3D-GS", "seg_point_cloud.ply"),
    MethodFile("SA3D-GS", _ITERATION + "seg_point_cloud_*.npy"),
    MethodFile("Gaussian Grouping, Gaga or Unified-Lift", _ITERATION + "classifier.pth", _ID),
    MethodFile("Gaussian Grouping, Gaga or Unified-Lift", "classifier.pth", _ID),
    MethodFile("OpenGaussian or InstanceGaussian", "cluster_lang.npz", _ID),
    MethodFile("InstanceGaussian", "cluster_result.pt", _ID),
    MethodFile("SAGD", _ITERATION + "point_cloud_seg.ply"),
    MethodFile("SAGD", "point_cloud_seg.ply"),
    MethodFile("OmniSeg3D-GS", _ITERATION + "debug_{object}_*.ply"),
    MethodFile("OmniSeg3D-GS", "debug_{object}_*.ply"),
    MethodFile("FlashSplat", "used_count/*_objnum_*.pth"),
    MethodFile("FlashSplat", "train/ours_*/used_count/*_objnum_*.pth"),
    MethodFile("Gradient-Driven Segmentation", "mask3d.pth"),
    MethodFile("COB-GS or NG-GS", "masks/{object}/chkpnt*.pth", own_scene=True),
    MethodFile("GaussianCut", "graphcut_{object}/remove_source.pt"),
    MethodFile("THGS", "nag-l*.pt", _ID),
    MethodFile("LUDVIG", "features.npy", "--selection.threshold T"),
    MethodFile("Trace3D", "objects/{object}_gaus_mask.pt"),
)
"""In the order in which they are looked for."""


def method_files_in(folder: Path) -> Iterator[tuple[Path, MethodFile]]:
    """Give the files that methods left in a folder, with what they are; of a method's checkpoints the latest."""
    for kind in METHOD_FILES:
        found = [path for path in sorted(folder.glob(kind.pattern.replace("{object}", "*"))) if path.is_file()]
        yield from ((path, kind) for path in (_latest(found) if kind.own_scene else found))


def selection_in(folder: Path) -> Path:
    """Return the one file in a folder that a method left as its selection.

    Raises:
        InputError: there is none, or there are several.
    """
    found = [path for path, _ in method_files_in(folder)] or _latest(folder.glob("chkpnt*.pth"))
    if len(found) == 1:
        return found[0]
    if not found:
        raise InputError(
            f"The folder '{folder}' holds no file of a known segmentation method; name the selection itself "
            "(docs/methods.md lists what methods write)."
        )
    names = ", ".join(str(path.relative_to(folder)) for path in found[:_LISTED])
    raise InputError(f"The folder '{folder}' holds several selections; give one of them: {names}.")


def scene_of_selection(scene: Path, selection: Path | None) -> Path:
    """Return the scene; or, of a folder given as both, the selection's file where that holds a scene of its own."""
    if scene == selection and scene.is_dir():
        found = [path for path, kind in method_files_in(scene) if kind.own_scene]
        return found[0] if len(found) == 1 else scene
    return scene


def _latest(paths: Iterable[Path]) -> list[Path]:
    """Of checkpoints in the same folder, the one of the latest iteration."""
    latest: dict[Path, Path] = {}
    for path in sorted(paths, key=lambda path: (len(path.name), path.name)):
        latest[path.parent] = path
    return list(latest.values())
