"""Write an object for a program: upright there, with its foot at the origin, and the scene without it to match."""

import tempfile
from pathlib import Path

import gaussian_trimmer as gt
from gaussian_trimmer import sample
from gaussian_trimmer.output.engines import ENGINES, PlacingOptions

scene = gt.read(sample.SCENE)
rough = gt.read_selection(sample.SELECTION, scene)
result = gt.trim(scene, rough, cameras=gt.read_cameras(sample.CAMERAS), config=gt.TrimConfig.of({"refine": "off"}))

folder = Path(tempfile.mkdtemp(prefix="engines-"))
for name in ("blender", "unreal", "three"):
    engine = ENGINES[name]
    place = PlacingOptions(name, scale=100).placement(result.object, result.objects[0].up.direction)  # centimetres
    for part in ("object", "background"):
        gt.write(place.apply(getattr(result, part)), folder / f"{part}_{name}{engine.reads[0]}")
    size = place.as_json(result.object)["box"]["size"]
    print(f"{engine.name}: {engine.reads[0]}, up {engine.up}, {max(size):.0f} units tall")
