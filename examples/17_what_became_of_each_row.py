"""What became of each Gaussian of the scene: the labels of a trim, and the same from labels.npz of its folder."""

import tempfile
from pathlib import Path

import numpy as np

import gaussian_trimmer as gt
from gaussian_trimmer import sample
from gaussian_trimmer.trimming.result import RowLabel

scene = gt.read(sample.SCENE)
rough = gt.read_selection(sample.SELECTION, scene)
result = gt.trim(scene, rough, up="z", config=gt.TrimConfig.of({"refine": "off", "plan.size": 256}))
for label in RowLabel:
    print(f"{label.name.lower()}: {result.count(label)} rows")

folder = gt.save(result, Path(tempfile.mkdtemp(prefix="rows-")))
saved = np.load(folder / "labels.npz")
in_object = saved["source_index"][: saved["n_object"]]  # scene rows of the object's file, in its order
made_up = saved["label"][saved["n_object"] :] == RowLabel.FILLED
print(f"the same rows: {np.array_equal(in_object, result.objects[0].source_index)}; {made_up.sum()} were not measured")
