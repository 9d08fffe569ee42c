"""Settings by the names of the command line's options: three ways to make the scene without the object."""

import gaussian_trimmer as gt
from gaussian_trimmer import sample

scene = gt.read(sample.SCENE)
rough = gt.read_selection(sample.SELECTION, scene)
cameras = gt.read_cameras(sample.CAMERAS)

print("without a setting:", gt.TrimConfig().background)
for background in ("exact", "clean", "filled"):
    config = gt.TrimConfig.of({"background": background, "refine": "off", "plan.size": 256})
    result = gt.trim(scene, rough, cameras=cameras, config=config)
    counts = gt.describe(result)["counts"]
    print(f"{background}: {counts['background']} Gaussians, {counts['hidden']} discarded, {counts['filled']} filled in")
