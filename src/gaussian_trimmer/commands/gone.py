"""What the last release had and this one has not, and what takes its place."""

from __future__ import annotations

GONE = {
    "completion": "Shells complete file names by themselves; 'gaussian-trimmer COMMAND --help' lists the options.",
    "evaluate objects": "Use 'evaluate' with a folder of masks for each object in --masks.",
    "evaluate spin-nerf": "Use 'evaluate' with the masks and cameras of a scene.",
    "evaluate 3d-ovs": "Use 'evaluate' with the masks and cameras of a scene.",
    "--masks-only": "Score a method's object or selection with 'evaluate'; masks alone are not scored.",
    "--renderer": "Leave it out: the CPU renderer draws everything.",
    "--photos": "Make masks of the photographs with any tool, and give their folder with --masks.",
    "--segmenter": "Give a model's folder with --sam, or a folder of masks with --masks; --preset paper uses GrabCut.",
    "--mask-files.folder": "Give the folder with --masks.",
    "--sam.model": "Give the folder with --sam.",
    "--sam2.model": "Give the folder with --sam.",
    "--export-viewer": "Open object.ply in any splat viewer; splat-transform writes a page that holds a scene.",
    "--viewer-part": "Open object.ply or background.ply in any splat viewer.",
    "--no-background": "Give --no-write-background; in a batch, --options --no-write-background.",
    "--memory": "Give --workers: each has a scene in memory.",
    "--gpus": "Leave it out: trims run on the CPU.",
    "--time-limit": "Leave it out; 'timeout' or a scheduler ends a batch, and the same command goes on.",
    "--retries": "Start the batch again: it tries what is not finished.",
    "--retry-failed": "Leave it out: what has failed is tried again.",
    "--coordinates": "It was for boxes, balls and planes, which the app ('view') has.",
    **{
        f"--{effect}{volume}": "Cut by boxes, balls and planes in the app ('view'), or give booleans: --add FILE."
        for effect in ("", "remove-", "intersect-")
        for volume in ("box3d", "sphere", "plane")
    },
    "--evidence.recover-limit": "Leave it out: what joins the object is seen as the object in most of what it shows.",
}
"""Commands and options of the last release -> a sentence with the cure. An entry stays for one release."""
