"""Which way is up: from the cameras, or from what the scene and an object stand on; and how sure that is."""

import gaussian_trimmer as gt
from gaussian_trimmer import sample
from gaussian_trimmer.trimming.up_vector import find_up

scene = gt.read(sample.SCENE)
rough = gt.read_selection(sample.SELECTION, scene)

found = {
    "the cameras": find_up(scene, gt.read_cameras(sample.CAMERAS)),
    "the scene": find_up(scene),
    "the object": find_up(scene, object_rows=rough),
    "you": find_up(scene, given="z"),
}
for who, up in found.items():
    print(f"by {who}: {up.direction.round(2)} ({up.source}, confidence {up.confidence:.2f})")
    if up.doubt():
        print(f"  {up.doubt()}")
