"""Find every object of a scene without a click, choose by what is known of each, and cut them out together."""

import tempfile
from pathlib import Path

import gaussian_trimmer as gt
from gaussian_trimmer import sample

scene, cameras = gt.read(sample.SCENE), gt.read_cameras(sample.CAMERAS)
found = gt.find_objects(scene, cameras=cameras)
for one in found:
    print(f"object {one.id}: {one.gaussians} Gaussians, {'sure' if one.sure else 'unsure'}, {one.why}")

tallest = max((one for one in found if one.sure), key=lambda one: one.size[2])
chosen = gt.chosen_objects(found, names={tallest.id: "tallest"})
together = gt.trim_objects(scene, chosen, cameras=cameras)
for part in together.objects:
    print(f"{part.title}: {len(part.gaussians)} Gaussians, centre {part.bounds.centre.round(2)}")

folder = gt.save(together, Path(tempfile.mkdtemp(prefix="objects-")))
print(f"A file for each object, and one scene without them: {folder}")
