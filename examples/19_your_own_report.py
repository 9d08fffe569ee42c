"""A report of your own from the one of a trim: numbers, the box of the object, and the sentences that people read."""

import json

import gaussian_trimmer as gt
from gaussian_trimmer import sample
from gaussian_trimmer.output.report import sentences, summary_rows

scene = gt.read(sample.SCENE)
rough = gt.read_selection(sample.SELECTION, scene)
result = gt.trim(scene, rough, cameras=gt.read_cameras(sample.CAMERAS), config=gt.TrimConfig.of({"refine": "off"}))

report = gt.describe(result, {"scene": sample.SCENE.name, "selection": sample.SELECTION.name})
(row,) = summary_rows(report)  # the columns of summary.csv
print(json.dumps({name: row[name] for name in ("state", "selected", "kept", "x", "y", "z", "height")}))
for sentence in sentences(report):
    print(sentence)
