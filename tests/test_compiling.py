"""Where compiled kernels cannot be kept, the package works all the same."""

import os
import subprocess
import sys

import numba
import pytest
import toy

from gaussian_trimmer import formats
from gaussian_trimmer.parallel import keeps_kernels


def test_kernels_are_kept_here():
    assert keeps_kernels()


@pytest.mark.parametrize("threads", ["0", "-2", "many"])
def test_a_number_of_threads_that_is_none_is_one_sentence(threads, tmp_path):
    formats.write(toy.ball_on_floor()[0], tmp_path / "scene.ply")
    done = subprocess.run(
        [sys.executable, "-m", "gaussian_trimmer", "info", str(tmp_path / "scene.ply")],
        env={**os.environ, "NUMBA_NUM_THREADS": threads}, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert f"NUMBA_NUM_THREADS={threads}" in done.stderr


@pytest.mark.slow
@pytest.mark.skipif(
    not hasattr(numba.config, "CACHE_LOCATOR_CLASSES"), reason="This Numba cannot be told to find no folder."
)
def test_without_a_folder_for_kernels_they_are_compiled_in_every_process():
    code = (
        "from gaussian_trimmer.parallel import keeps_kernels\n"
        "from gaussian_trimmer.geometry.graphs import connected_points\n"
        "import numpy as np\n"
        "print(keeps_kernels(), connected_points(np.diag([0.0, 1, 5]), 2.0).tolist())"
    )
    environment = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    environment["NUMBA_CACHE_LOCATOR_CLASSES"] = "UserProvidedCacheLocator"
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.split(maxsplit=1) == ["False", "[0, 0, 1]\n"]


def test_kernels_that_do_not_fit_on_the_disk_are_used_all_the_same(tmp_path):
    """Said once. The limit on the size of files stands for a full disk."""
    pytest.importorskip("resource", reason="needs limits on the size of files")
    code = (
        "import resource\nresource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000))\n"
        "from gaussian_trimmer.parallel import compiled, keeps_kernels\nfrom elsewhere.more import more\n"
        "made = [compiled()(f)(1) for f in (lambda x: x + 1, more)]\nprint(keeps_kernels(), made)"
    )
    (tmp_path / "code.py").write_text(code)
    (tmp_path / "elsewhere").mkdir()  # another folder to keep kernels in
    (tmp_path / "elsewhere" / "more.py").write_text("def more(x): return x + 2")
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "kept")}
    done = subprocess.run(
        [sys.executable, str(tmp_path / "code.py")], env=environment, capture_output=True, text=True, check=False
    )
    assert done.stdout == "True [2, 3]\n", done.stderr
    assert done.stderr.count("\n") == 1 and str(tmp_path / "kept") in done.stderr
