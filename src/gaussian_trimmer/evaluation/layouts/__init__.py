"""Layouts of published data sets with ground-truth masks: a module each, and the table of those that exist."""

from __future__ import annotations

from gaussian_trimmer.evaluation.layouts import lerf_mask, lerf_ovs, nvos, spin_nerf
from gaussian_trimmer.evaluation.layouts.layout import Layout

LAYOUTS: dict[str, Layout] = {
    "nvos": nvos.LAYOUT,
    "lerf-mask": lerf_mask.LAYOUT,
    "spin-nerf": spin_nerf.LAYOUT,
    "lerf-ovs": lerf_ovs.LAYOUT,
    "3d-ovs": lerf_mask.OVS_3D,
}
