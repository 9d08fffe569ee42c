"""What a service meets: inputs that cannot be used, and objects that are returned as they came."""

import numpy as np

import gaussian_trimmer as gt
from gaussian_trimmer import sample

scene = gt.read(sample.SCENE)
rough = gt.read_selection(sample.SELECTION, scene)

for wrong in ("nowhere.npy", np.zeros(len(scene), bool), np.ones(3, bool)):
    try:
        gt.trim(scene, gt.read_selection(wrong, scene) if isinstance(wrong, str) else wrong, up="z")
    except gt.InputError as error:  # one sentence with the cure; any other exception is a defect
        print(f"cannot: {error}")

scattered = np.random.default_rng(0).random(len(scene)) < 0.02
result = gt.trim(scene, scattered, up="z")
print(f"as it came: {result.objects[0].refused}")
result = gt.trim(scene, rough, up="z", config=gt.TrimConfig.of({"refine": "off", "background": "exact"}))
print(f"trimmed: {len(result.object)} Gaussians, warnings: {list(result.objects[0].warnings)}")
