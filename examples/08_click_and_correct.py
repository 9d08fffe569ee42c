"""Select by clicks in views, correct by further ones, and keep the marks: they make the selection again."""

import tempfile
from pathlib import Path

import gaussian_trimmer as gt
from gaussian_trimmer import sample

scene, cameras = gt.read(sample.SCENE), gt.read_cameras(sample.CAMERAS)

marks: list[gt.marks.Mark] = [gt.marks.Click(268, 166, view="002.png")]
tower = gt.select(scene, marks, cameras=cameras)
print(f"a click: {tower.mask.sum()} Gaussians, {tower.interpretations[-1]}")

marks.append(gt.marks.Sphere((-0.18, -0.18, 0.07), 0.1))  # adds what lies in a ball: the mug
marks.append(gt.marks.Box3D((-1, -1, 0.01), (1, 1, 1), effect="intersect"))  # keeps what is above the table
smaller = gt.select(scene, marks, cameras=cameras)
print(f"and more marks: {smaller.mask.sum()} Gaussians")

saved = Path(tempfile.mkdtemp(prefix="marks-")) / "selection.json"
smaller.save_marks(saved)
again = gt.select(scene, saved, cameras=cameras)
print(f"the same from {saved.name}: {bool((again.mask == smaller.mask).all())}")

result = gt.trim(scene, smaller, cameras=cameras)
print(f"trimmed: {result.object_mask.sum()} Gaussians")
