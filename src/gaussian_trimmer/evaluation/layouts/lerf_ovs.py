"""LERF-OVS: objects named by words, as polygons in some pictures of the scenes of LERF.

    ROOT/label/<scene>/frame_00041.json         polygons, several of one object perhaps
    ROOT/<scene>/images/frame_00041.jpg         the picture, if it is there

The score is the mean over all objects in all pictures of a scene, and over scenes.
"""

from __future__ import annotations

from pathlib import Path

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.evaluation.ground_truth import read_polygons
from gaussian_trimmer.evaluation.layouts.layout import Layout, LayoutTask, Target, folders_in, pictures_in


def find_tasks(root: Path) -> list[LayoutTask]:
    """The tasks below a folder; see `Layout.find_tasks`."""
    tasks = []
    for folder in folders_in(root / "label"):
        images = {path.stem: path for path in pictures_in(root / folder.name / "images") or pictures_in(folder)}
        targets: dict[str, list[Target]] = {}
        for file in sorted(folder.glob("*.json")):
            for category in read_polygons(file)[1]:
                target = Target(file.stem, file, images.get(file.stem), category)
                targets.setdefault(category, []).append(target)
        tasks += [LayoutTask(folder.name, words, tuple(found)) for words, found in sorted(targets.items())]
    if not tasks:
        raise InputError(f"'{root}' has no files 'label/<scene>/<picture>.json'; give the folder of LERF-OVS.")
    return tasks


LAYOUT = Layout("LERF-OVS", find_tasks, expected=None, mean_by_scene=True, mean_by_view=True)
