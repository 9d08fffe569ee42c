"""Write a scene in every format: how large it becomes, how far centres move, and what is lost."""

import tempfile
from pathlib import Path

import numpy as np

import gaussian_trimmer as gt
from gaussian_trimmer import formats, sample
from gaussian_trimmer.formats.packing import morton_order

scene = gt.read(sample.SCENE)
scene = scene.select(morton_order(scene.means))  # compressed files become smaller and more precise
folder = Path(tempfile.mkdtemp(prefix="formats-"))
for suffix in formats.FORMATS:
    path = folder / f"scene{suffix}"
    gt.write(scene, path)
    moved = np.abs(gt.read(path).means - scene.means).max()
    lost = formats.losses(scene, suffix, ".ply")
    print(f"{suffix}: {path.stat().st_size / 1e6:.1f} MB, centres move by {moved:.1e} at most. {lost}")
