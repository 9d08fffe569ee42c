"""Trim one object: the lighthouse of the sample scene, which was selected with table around its foot."""

import tempfile
from pathlib import Path

import gaussian_trimmer as gt
from gaussian_trimmer import sample

scene = gt.read(sample.SCENE)
rough = gt.read_selection(sample.SELECTION, scene)
result = gt.trim(scene, rough, cameras=gt.read_cameras(sample.CAMERAS))

folder = gt.save(result, Path(tempfile.mkdtemp(prefix="lighthouse-")))
print(
    f"{rough.sum()} Gaussians selected, {result.object_mask.sum()} after trimming; see {folder / 'before_after.png'}."
)
