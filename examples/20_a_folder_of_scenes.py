"""A manifest for `gaussian-trimmer batch` from a folder of scenes with selections, and what its first rows will do."""

import csv
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from gaussian_trimmer import sample

folder = Path(tempfile.mkdtemp(prefix="scenes-"))
for name in ("kitchen", "garden"):  # stand for captures of yours
    shutil.copy(sample.SCENE, folder / f"{name}.ply")
    shutil.copy(sample.SELECTION, folder / f"{name}.npy")

with (folder / "manifest.csv").open("w", newline="") as file:
    table = csv.writer(file)
    table.writerow(["scene", "selection", "name", "up"])
    for scene in sorted(folder.glob("*.ply")):
        table.writerow([scene.name, scene.with_suffix(".npy").name, scene.stem, "z"])

options = "--refine off --background exact --views 3"
command: list[str | Path] = [
    sys.executable,
    "-m",
    "gaussian_trimmer",
    "batch",
    folder / "manifest.csv",
    "--output",
    folder / "out",
]
subprocess.run([*command, "--options", options, "--workers", "1", "--quiet"], check=True)
for row in csv.DictReader((folder / "out" / "summary.csv").open()):
    print(f"{row['name']}: {row['state']}, {row['object']} Gaussians, {row['height']} high")
