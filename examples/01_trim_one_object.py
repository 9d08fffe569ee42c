"""Trim one object: the lighthouse of the sample scene, which was selected with table around its foot."""

import tempfile
from pathlib import Path

from gaussian_trimmer import formats, sample
from gaussian_trimmer.camera_files import read_camera_set
from gaussian_trimmer.output.pictures import draw_before_after, write_picture
from gaussian_trimmer.pipeline import trim
from gaussian_trimmer.rendering import get_renderer
from gaussian_trimmer.selection_files import load_selection

scene = formats.read(sample.SCENE)
rough = load_selection(sample.SELECTION, scene)
renderer = get_renderer("auto")
result = trim(scene, rough, renderer=renderer, cameras=read_camera_set(sample.CAMERAS))

folder = Path(tempfile.mkdtemp(prefix="lighthouse-"))
formats.write(result.object, folder / "object.ply")
formats.write(result.background, folder / "background.ply")
write_picture(draw_before_after(result, rough, renderer), folder / "before_after.png")
print(f"{rough.sum()} Gaussians selected, {len(result.object)} after trimming; see {folder / 'before_after.png'}.")
