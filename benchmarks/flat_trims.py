"""What becomes of the furniture of whole flats when it is cut out, and of the flats without it? No cameras are given.

    python benchmarks/flat_trims.py [--seeds 1 2 3] [--counts 120000 400000] [--kinds exact grown] [--only TEXT]
                                    [--pictures DIR]

Each thing of each flat of flats.py is trimmed from its own Gaussians (exact) and from those near it as well (grown).
Gaussians count by opacity times cross-section. `kept` is what the object has of the thing, `foreign` what it has of
anything else, both relative to the thing. A trim is spoilt if it keeps less than 0.9 or has more than 0.1 of other
things, and the selection was better. `without` is the PSNR in dB of the flat without the thing against the flat made
without it, where the thing was, in the four views at eye height that show it best, of eight around it.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from flats import Flat, make_flat
from quality import parser_of

from gaussian_trimmer.cameras import Camera, intrinsics, look_at
from gaussian_trimmer.gaussians import BoolArray, Float64Array, Gaussians
from gaussian_trimmer.geometry.graphs import nearest
from gaussian_trimmer.output.pictures import as_picture, write_picture
from gaussian_trimmer.rendering import blend_values, render
from gaussian_trimmer.trimming.trim import trim
from gaussian_trimmer.views.view import HALF

_SPOILT_KEPT, _SPOILT_FOREIGN, _NO_WORSE = 0.9, 0.1, 0.03
_GROWN = 0.04
"""How far from a thing Gaussians lie that are selected with it, relative to the thing's diagonal."""
_EYE_HEIGHT, _SIZE, _FOV = 1.6, 400, np.radians(60)


class Outcome(NamedTuple):
    """What became of one thing."""

    thing: str
    kind: str
    refused: bool
    before: tuple[float, float]
    """What the selection keeps of the thing, and what it has of others."""
    after: tuple[float, float]
    without: float
    """PSNR of the flat without it, in dB; NaN where nothing was removed, or nothing of the thing is seen."""

    @property
    def spoilt(self) -> bool:
        """Whether the object is bad, and worse than the selection."""
        kept = self.after[0] < min(_SPOILT_KEPT, self.before[0] - _NO_WORSE)
        return kept or self.after[1] > max(_SPOILT_FOREIGN, self.before[1] + _NO_WORSE)


def outcomes(flat: Flat, kinds: list[str], only: str, pictures: Path | None) -> Iterator[Outcome]:
    """Trim every thing of a flat whose name holds a text."""
    counts = flat.gaussians.opacities * np.exp(np.sort(flat.gaussians.log_scales, axis=1)[:, 1:].sum(axis=1))
    for number, thing in enumerate(flat.names, 1):
        own = flat.labels == number
        for kind in kinds if only in thing else []:
            selected = own | _near(flat.gaussians, own) if kind == "grown" else own
            result = trim(flat.gaussians, selected, up="z")
            taken = result.object_mask
            shares = [
                (
                    float(counts[part & own].sum() / counts[own].sum()),
                    float(counts[part & ~own].sum() / counts[own].sum()),
                )
                for part in (selected, taken)
            ]
            picture = pictures / f"{thing.replace(' ', '_')}_{kind}.png" if pictures else None
            without = np.nan if result.nothing_trimmed else _psnr(flat, number, result.background, picture)
            yield Outcome(thing, kind, result.nothing_trimmed, shares[0], shares[1], without)


def _near(gaussians: Gaussians, own: BoolArray) -> BoolArray:
    """Which Gaussians lie near to some, (N,)."""
    reach = _GROWN * float(np.linalg.norm(np.ptp(gaussians.means[own], axis=0)))
    squared, _ = nearest(gaussians.means[own], gaussians.means, 1)
    return np.asarray(np.sqrt(squared[:, 0]) < reach)


def _psnr(flat: Flat, number: int, background: Gaussians, picture: Path | None) -> float:
    """Compare the flat without a thing with the flat made without it, and write what is seen, if asked."""
    own, truth = (flat.labels == number).astype(np.float32), flat.without(number)
    views = []
    for camera in _eyes(flat, number):
        shown = blend_values(flat.gaussians, camera, own[:, None])[..., 0] > HALF
        views.append((camera, render(flat.gaussians, camera).rgb, shown))
    views.sort(key=lambda view: -int(view[2].sum()))
    errors, strips = [], []
    for camera, before, where in views[:4]:
        after, true = render(background, camera).rgb, render(truth, camera).rgb
        errors.append(((np.clip(after, 0, 1) - np.clip(true, 0, 1))[where] ** 2).ravel())
        strips.append(np.concatenate([before, after, true], axis=1))
    if picture is not None:
        write_picture(as_picture(np.concatenate(strips)), picture)
    squared = np.concatenate(errors)
    return float(-10 * np.log10(squared.mean())) if len(squared) else np.nan


def _eyes(flat: Flat, number: int) -> Iterator[Camera]:
    """Look at a thing from eight sides, from where nothing is within arm's length."""
    thing = flat.gaussians.means[flat.labels == number].astype(np.float64)
    centre, up = (thing.min(axis=0) + thing.max(axis=0)) / 2, np.array([0.0, 0.0, 1.0])
    radius = float(np.linalg.norm(np.ptp(thing, axis=0)) / 2)
    for angle in np.arange(8) * np.pi / 4:
        eye: Float64Array = centre + (radius + 1.2) * np.array([np.cos(angle), np.sin(angle), 0])
        eye[2] = _EYE_HEIGHT
        yield Camera(look_at(eye, centre, up), intrinsics(_FOV, _SIZE, _SIZE), _SIZE, _SIZE, near=0.05)


def main() -> None:
    """Print a line for each trim, and one for each flat."""
    parser = parser_of(__doc__)
    parser.add_argument("--seeds", nargs="+", type=int, default=[1, 2, 3], help="which flats")
    parser.add_argument("--counts", nargs="+", type=int, default=[120_000], help="about how many Gaussians")
    parser.add_argument("--kinds", nargs="+", choices=["exact", "grown"], default=["exact", "grown"])
    parser.add_argument("--only", default="", help="only things whose names hold this text")
    parser.add_argument("--pictures", type=Path, help="folder for pictures: before, without it, made without it")
    arguments = parser.parse_args()
    if arguments.pictures:
        arguments.pictures.mkdir(parents=True, exist_ok=True)
    for seed in arguments.seeds:
        for count in arguments.counts:
            every = []
            for one in outcomes(make_flat(seed, count), arguments.kinds, arguments.only, arguments.pictures):
                every.append(one)
                print(
                    f"  {one.thing:22s} {one.kind:6s} kept {one.before[0]:.2f} -> {one.after[0]:.2f}, foreign "
                    f"{one.before[1]:.2f} -> {one.after[1]:.2f}, without {one.without:.1f} dB"
                    f"{' refused' * one.refused}{' spoilt' * one.spoilt}",
                    flush=True,
                )
            without = np.array([one.without for one in every])
            print(
                f"flat {seed} of {count:,}: {len(every)} trims, {sum(one.refused for one in every)} refused, "
                f"{sum(one.spoilt for one in every)} spoilt; without them {np.nanmean(without):.1f} dB, "
                f"least {np.nanmin(without):.1f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
