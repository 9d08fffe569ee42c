"""Measure a selection and its trim against ground-truth masks, by both rules of occlusion.

On the command line this is `gaussian-trimmer evaluate`. The masks show what is visible of the lighthouse: where a fern
stands before it they have a hole, which the object has in its scene and not alone.
"""

import gaussian_trimmer as gt
from gaussian_trimmer import sample
from gaussian_trimmer.evaluation.ground_truth import views_in
from gaussian_trimmer.evaluation.scoring import Cut, Judge, cut_by, mean_scores

scene = gt.read(sample.SCENE)
rough = gt.read_selection(sample.SELECTION, scene)
cameras = gt.read_cameras(sample.CAMERAS)
result = gt.trim(scene, rough, cameras=cameras)

views = list(views_in(cameras.pinhole_cameras(), sample.MASKS)[1])
for name, cut in (("selection", cut_by(scene, rough)), ("trim", Cut(result.object, result.background))):
    scores = mean_scores(Judge().score_views(cut, views))
    print(f"{name}: IoU {scores['iou']:.1f} alone, {scores['iou_in_scene']:.1f} in scene, means of {len(views)} views")
