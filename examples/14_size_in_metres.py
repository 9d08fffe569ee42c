"""How large an object is in metres, where the real height of one thing is known."""

import numpy as np

import gaussian_trimmer as gt
from gaussian_trimmer import sample

LIGHTHOUSE_METRES = 0.30  # measured with a ruler

scene = gt.read(sample.SCENE)
rough = gt.read_selection(sample.SELECTION, scene)
config = gt.TrimConfig.of({"refine": "off", "background": "exact", "plan.size": 256})
result = gt.trim(scene, rough, up="z", config=config)

units = 2 * result.objects[0].bounds.half_extents  # length, width, height
scale = LIGHTHOUSE_METRES / units[2]
print(f"a metre is {1 / scale:.3f} units; give --scale {scale:.3f} for files in metres")
print(f"the lighthouse is {' x '.join(f'{size:.2f}' for size in units * scale)} m")
print(f"the scene is {np.ptp(scene.means, axis=0).max() * scale:.1f} m wide")
