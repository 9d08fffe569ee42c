"""Where compiled kernels cannot be kept, the package works all the same."""

import os
import subprocess
import sys

import numba
import pytest

from gaussian_trimmer.geometry.compiling import CACHE


def test_kernels_are_kept_here():
    assert CACHE


@pytest.mark.skipif(
    not hasattr(numba.config, "CACHE_LOCATOR_CLASSES"), reason="This Numba cannot be told to find no folder."
)
def test_without_a_folder_for_kernels_they_are_compiled_in_every_process():
    code = (
        "from gaussian_trimmer.geometry.compiling import CACHE\n"
        "from gaussian_trimmer.geometry.kd_tree import nearest\n"
        "import numpy as np\n"
        "points = np.float32([[0], [1], [5]])\n"
        "print(CACHE, nearest(points, points, 1)[1].ravel().tolist())"
    )
    environment = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    environment["NUMBA_CACHE_LOCATOR_CLASSES"] = "UserProvidedCacheLocator"
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.split(maxsplit=1) == ["False", "[0, 1, 2]\n"]
