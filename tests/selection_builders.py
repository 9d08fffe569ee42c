"""Scenes and method outputs for the tests of selections, with the names, shapes and types that the methods write."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gaussian_trimmer.formats import ply
from gaussian_trimmer.gaussians import Gaussians

N_FEATURES = 16


def make_scene(n: int = 12, *, coefficients: int = 15, seed: int = 0, extras: dict | None = None) -> Gaussians:
    rng = np.random.default_rng(seed)

    def numbers(*shape: int) -> np.ndarray:
        return rng.normal(size=(n, *shape)).astype(np.float32)

    return Gaussians(numbers(3), numbers(3), numbers(4), numbers(), numbers(3), numbers(3, coefficients), extras or {})


def rows_mask(n: int, *rows: int) -> np.ndarray:
    mask = np.zeros(n, bool)
    mask[list(rows)] = True
    return mask


def save_ply(path: Path, gaussians: Gaussians, rows: list[int] | None = None) -> Path:
    ply.write(gaussians if rows is None else gaussians.select(np.array(rows)), path, extras=True)
    return path


def save_ply_like_sa3d_gs(path: Path, gaussians: Gaussians, rows: list[int], mask: list[float]) -> Path:
    """`seg_point_cloud.ply`: the property `mask` stands between z and nx."""
    part = gaussians.select(np.array(rows))
    rest = part.sh_rest.reshape(len(part), -1)
    blocks = {
        ("x", "y", "z"): part.means,
        ("mask",): np.float32(mask)[:, None],
        ("nx", "ny", "nz"): np.zeros((len(part), 3), np.float32),
        ("f_dc_0", "f_dc_1", "f_dc_2"): part.sh_dc,
        tuple(f"f_rest_{i}" for i in range(rest.shape[1])): rest,
        ("opacity",): part.opacity_logits[:, None],
        ("scale_0", "scale_1", "scale_2"): part.log_scales,
        ("rot_0", "rot_1", "rot_2", "rot_3"): part.quaternions,
    }
    names = [name for block in blocks for name in block]
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(part)}\n"
    header += "".join(f"property float {name}\n" for name in names) + "end_header\n"
    path.write_bytes(header.encode() + np.concatenate(list(blocks.values()), axis=1).astype("<f4").tobytes())
    return path


def identity_columns(ids: list[int]) -> dict[str, np.ndarray]:
    """obj_dc_0 .. obj_dc_15, in which each id is a direction of its own."""
    features = 4 * np.eye(N_FEATURES, dtype=np.float32)[ids]
    return {f"obj_dc_{i}": features[:, i] for i in range(N_FEATURES)}


def classifier_state(n_ids: int):
    """State of Gaussian Grouping's Conv2d(16, K, 1) that maps feature k to id k."""
    import torch

    layer = torch.nn.Conv2d(N_FEATURES, n_ids, kernel_size=1)
    with torch.no_grad():
        layer.weight.copy_(torch.eye(n_ids, N_FEATURES)[:, :, None, None])
        layer.bias.zero_()
    return layer.state_dict()


def checkpoint_state(gaussians: Gaussians, extra=None) -> tuple:
    """What the original's capture() returns: parameters, an optimizer's state with rates of NumPy, and the extent."""
    import torch

    def parameter(entry):
        tensor = torch.tensor(np.ascontiguousarray(entry)) if isinstance(entry, np.ndarray) else entry
        return torch.nn.Parameter(tensor) if isinstance(tensor, torch.Tensor) else tensor

    degree, *entries, _, extent = checkpoint_entries(gaussians, extra)
    parameters = [parameter(entry) for entry in entries]
    optimizer = torch.optim.Adam([{"params": parameters[:6], "lr": np.float32(0.00016) * np.float64(extent)}])
    sum(0 * tensor.sum() for tensor in parameters[:6]).backward()
    optimizer.step()  # all gradients are zero
    return (degree, *parameters, optimizer.state_dict(), np.float64(extent))


def checkpoint_entries(gaussians: Gaussians, extra: np.ndarray | None = None) -> tuple:
    """The entries that `checkpoint_state` gives, as arrays and without an optimizer's state."""
    n = len(gaussians)
    tensors = (gaussians.means, gaussians.sh_dc[:, None], gaussians.sh_rest.transpose(0, 2, 1), gaussians.log_scales)
    tensors += (gaussians.quaternions, gaussians.opacity_logits[:, None])
    rest = (np.zeros(n, np.float32), np.zeros((n, 1), np.float32), np.zeros((n, 1), np.float32), {}, 4.7)
    return (gaussians.sh_degree, *tensors, *([] if extra is None else [extra]), *rest)
