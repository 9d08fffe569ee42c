"""Trim several objects of a scene together, from the id of each Gaussian's object: no Gaussian is in two of them."""

import numpy as np

import gaussian_trimmer as gt
from gaussian_trimmer import sample

scene = gt.read(sample.SCENE)
rough = gt.read_selection(sample.SELECTION, scene)

heights = scene.means[rough][:, 2]
ids = np.zeros(len(scene), np.int64)  # as a segmentation network gives them, 0 for none
ids[np.flatnonzero(rough)] = np.where(heights > np.median(heights), 2, 1)

config = gt.TrimConfig.of({"refine": "off", "background": "exact", "plan.size": 256})
result = gt.trim_objects(scene, ids, up="z", config=config)
for part in result.objects:
    print(
        f"object {part.id}: {len(part.selected_rows)} selected, {len(part.gaussians)} in it, {part.lost} to the other"
    )
print(f"claimed by both: {result.contested}; in either: {np.count_nonzero(result.labels)}")
