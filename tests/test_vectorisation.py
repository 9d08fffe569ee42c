"""Blending runs as vector code: counted in the machine code, since losing it changes no result and costs ten times.

The loops over pixels are basic blocks of their own in the code; each is told by the packed single-precision products,
fused or not, that it consists of, and the loop that finds weights by its minima as well. The number of these does not
depend on the vectors' width.
"""

import platform
import re
from functools import cache

import numba
import numpy as np
import pytest
from scenes import front_camera, random_scene

from gaussian_trimmer.rendering import blend_weights, numba_kernels, render, tile_renderer

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        platform.machine().lower() not in ("x86_64", "amd64"),
        reason=f"The instructions counted are those of x86-64, not of {platform.machine()}.",
    ),
    pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="NUMBA_DISABLE_JIT is set, so nothing is compiled."),
]

PACKED_PRODUCT = re.compile(r"^\s+v?(?:mul|fn?m(?:add|sub)\d*)ps\b", re.MULTILINE)
PACKED_MINIMUM = re.compile(r"^\s+v?minps\b", re.MULTILINE)
DOUBLES = re.compile(r"^\s+v?cvtps2pd\b", re.MULTILINE)
LABEL = re.compile(r"^\S+:.*$", re.MULTILINE)

# The exponent takes 5 products, the polynomial 5, its three squarings 3, alpha and weight one each: 15, of which a
# compiler may fold a few. The sums of values and of labels have four products each, one for each Gaussian of a batch.
PRODUCTS_OF_THE_WEIGHT = 13
PRODUCTS_OF_A_SUM = 4


def recompiled(function):
    """A new dispatcher of a compiled function: code that comes from the cache cannot be inspected."""
    options = {name: value for name, value in function.targetoptions.items() if name != "nopython"}
    return numba.njit(**options)(function.py_func)


def products_by_block(assembly, with_minima):
    """Packed products of the basic blocks that have any, most first; of those with packed minima or those without."""
    blocks = (block for block in LABEL.split(assembly) if bool(PACKED_MINIMUM.search(block)) == with_minima)
    counts = (len(PACKED_PRODUCT.findall(block)) for block in blocks)
    return sorted((count for count in counts if count), reverse=True)


@cache
def assembly_of_blending():
    """The machine code for all types that drawing calls the kernel with."""
    kernel = recompiled(numba_kernels.blend_tiles)
    gaussians, camera = random_scene(0, 40), front_camera(48, 32)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tile_renderer, "blend_tiles", kernel)
        render(gaussians, camera)
        blend_weights(gaussians, camera, np.zeros((32, 48), np.uint8), 2)
    return [kernel.inspect_asm(signature) for signature in kernel.signatures]


def test_drawing_blends_with_the_code_that_is_inspected():
    assert len(assembly_of_blending()) >= 1


def test_weights_of_pixels_are_vector_code():
    for assembly in assembly_of_blending():
        assert products_by_block(assembly, with_minima=True)[0] >= PRODUCTS_OF_THE_WEIGHT


def test_sums_of_values_and_of_labels_are_vector_code():
    for assembly in assembly_of_blending():
        sums = products_by_block(assembly, with_minima=False)
        assert sum(count >= PRODUCTS_OF_A_SUM for count in sums) >= 2  # one loop over values, one over labels


def test_nothing_is_widened_to_double_precision():
    for assembly in assembly_of_blending():
        assert DOUBLES.search(assembly) is None
