"""How well is the furniture of whole flats found, without cameras and without a click?

    python benchmarks/flats.py OUTPUT [--seeds 1 2 3] [--counts 400000 120000]

Each seed makes another flat: rooms side by side with walls, doorways and a ceiling, and furniture that stands in them,
hangs on their walls or lies on tables, all of small flat Gaussians. A thing is found if a sure object overlaps its
footprint, the box between the 3rd and 97th percentiles of centres on the plan, with an IoU of 0.4 or more, one to one;
its Gaussians are compared as well. For each flat the plan that `objects` draws is written to OUTPUT.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from bodies import Part, Texture, checks, grain, plain
from quality import parser_of
from rooms import bookcase, cabinet, discs, lamp, picture, plant

from gaussian_trimmer.finding.find import find_objects
from gaussian_trimmer.finding.found import SURE
from gaussian_trimmer.finding.saving import draw_plan
from gaussian_trimmer.gaussians import SH_C0, BoolArray, Float64Array, Gaussians, IntArray, concatenate
from gaussian_trimmer.output.pictures import write_picture

_HEIGHT, _DOOR_HEIGHT, _DOOR_WIDTH, _WALL = 2.6, 2.05, 0.9, 0.1
_THINNED = 0.012, 0.045
"""Spacings between which that of the Gaussians is searched."""
_FLOATERS, _MEAN_LOGIT = 0.01, 2.5
_MIN_FOOTPRINT_IOU = 0.4
_ENDS = (3, 97)


Furniture = list[Part]
"""Bodies about a place on the floor; the front is +y."""


@dataclass(frozen=True, eq=False)
class Flat:
    """A flat and which thing each of its Gaussians is of, from 1; 0 is the flat itself."""

    gaussians: Gaussians
    labels: IntArray
    shell: list[Part]
    things: dict[str, Furniture]
    spacing: float
    """About how far its Gaussians are apart."""

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.things)

    def without(self, number: int) -> Gaussians:
        """The flat as it would be without a thing: its shadow is gone, and what it covers is there."""
        stays, rng = self.labels != number, np.random.default_rng(number)
        rest, own = self.gaussians.select(stays), list(self.things.values())[number - 1]
        others = [part for name, parts in self.things.items() if name != self.names[number - 1] for part in parts]
        points = rest.means.astype(np.float64)
        lit = np.where(self.labels[stays] == 0, _shadow(points, others) / _shadow(points, [*others, *own]), 1)
        rest = rest.replace(sh_dc=(((0.5 + SH_C0 * rest.sh_dc) * lit[:, None] - 0.5) / SH_C0).astype(np.float32))
        covered = [rest]
        for part in self.shell:
            where, facing = part.sample(self.spacing, rng)
            hidden = _within(where, facing, own) & ~_within(where, facing, others)
            where, facing = where[hidden], facing[hidden]
            colours = part.texture(where) * (_shade(facing) * _shadow(where, others))[:, None]
            new = discs(where, facing, colours, np.full(len(where), self.spacing))
            covered.append(new.replace(opacity_logits=np.full(len(where), _MEAN_LOGIT)))
        return concatenate(covered)


def _legs(width: float, depth: float, height: float, wood: Texture, thick: float = 0.05) -> Furniture:
    x, y = (width - thick) / 2, (depth - thick) / 2
    return [Part((i * x, j * y, height / 2), (thick, thick, height), wood) for i in (-1, 1) for j in (-1, 1)]


def _table(width: float, depth: float, height: float, wood: Texture) -> Furniture:
    return [Part((0, 0, height - 0.02), (width, depth, 0.04), wood), *_legs(width, depth, height - 0.04, wood)]


def _chair(cloth: Texture, wood: Texture) -> Furniture:
    return [
        *_legs(0.44, 0.44, 0.43, wood, 0.04),
        Part((0, 0, 0.455), (0.45, 0.45, 0.05), cloth),
        Part((0, -0.21, 0.72), (0.43, 0.04, 0.5), cloth),
    ]


def _armchair(cloth: Texture) -> Furniture:
    return [
        Part((0, 0, 0.24), (0.62, 0.62, 0.34), cloth),
        Part((0, -0.28, 0.6), (0.62, 0.14, 0.5), cloth),
        *(Part((side * 0.37, 0, 0.32), (0.14, 0.66, 0.5), cloth) for side in (-1, 1)),
    ]


def _sofa(width: float, cloth: Texture, rng: np.random.Generator) -> Furniture:
    parts = [
        Part((0, 0, 0.22), (width, 0.85, 0.36), cloth),
        Part((0, -0.36, 0.55), (width, 0.18, 0.5), cloth),
        *(Part((side * (width / 2 - 0.09), 0, 0.4), (0.18, 0.85, 0.42), cloth) for side in (-1, 1)),
    ]
    for x in np.linspace(-width / 2 + 0.4, width / 2 - 0.4, int(rng.integers(2, 5))):
        lean, cushion = np.radians(rng.uniform(10, 30)), plain(*rng.uniform(0.15, 0.85, 3), noise=0.03)
        turn = np.array([[1, 0, 0], [0, np.cos(lean), np.sin(lean)], [0, -np.sin(lean), np.cos(lean)]])
        parts.append(Part((x, -0.17, 0.62), (0.42, 0.13, 0.42), cushion, "ball", turn))
    return parts


def _bed(width: float, wood: Texture, rng: np.random.Generator) -> Furniture:
    cover, white = plain(*rng.uniform(0.2, 0.8, 3), noise=0.03), plain(0.86, 0.85, 0.83)
    return [
        Part((0, 0.05, 0.2), (width, 2.0, 0.3), wood),
        Part((0, -0.98, 0.55), (width, 0.06, 0.9), wood),
        Part((0, 0.05, 0.43), (width - 0.06, 1.95, 0.18), white),
        Part((0, 0.35, 0.54), (width, 1.35, 0.06), cover),
        *(Part((x, -0.65, 0.58), (0.6, 0.4, 0.16), white, "ball") for x in ((-0.4, 0.4) if width > 1.2 else (0,))),
    ]


def _tall_plant(rng: np.random.Generator) -> Furniture:
    return plant(0, 0, rng)


def _things_on(table: Furniture, height: float, reach: float, rng: np.random.Generator) -> Furniture:
    """A vase and books on a table: part of what stands there."""
    vase = plain(*rng.uniform(0.2, 0.8, 3))
    book = plain(*rng.uniform(0.2, 0.8, 3))
    x = rng.uniform(-reach, reach)
    return [
        *table,
        Part((x, 0.05, height + 0.11), (0.12, 0.12, 0.22), vase, "cylinder"),
        Part((-x, -0.05, height + 0.02), (0.22, 0.16, 0.04), book),
    ]


def _television(rng: np.random.Generator) -> Furniture:
    return [
        Part((0, -0.02, 0.42), (1.1, 0.06, 0.64), plain(0.06, 0.06, 0.07)),
        Part((0, 0, 0.05), (0.5, 0.2, 0.1), plain(0.1, 0.1, 0.1)),
    ]


def _at(parts: Furniture, x: float, y: float, angle: float, z: float = 0.0) -> Furniture:
    """The same at another place, turned about the up vector by an angle, in degrees."""
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    return [
        Part(
            tuple(turn @ part.centre + [x, y, z]),
            part.size,
            part.texture,
            part.shape,
            turn @ part.turn,
            None,
            part.opacity,
        )
        for part in parts
    ]


def _woods(rng: np.random.Generator) -> Texture:
    tone = np.array([(0.62, 0.43, 0.27), (0.3, 0.2, 0.13), (0.8, 0.78, 0.74), (0.47, 0.31, 0.2)][rng.integers(4)])
    return grain(*tone, along=int(rng.integers(2)))


def _cloth(rng: np.random.Generator) -> Texture:
    return plain(*np.clip(rng.uniform(0.15, 0.8) + rng.normal(0, 0.08, 3), 0.05, 0.9), noise=0.03)


def _furnish(kind: str, width: float, depth: float, rng: np.random.Generator) -> dict[str, Furniture]:
    """Furniture of a room of a kind, about the room's corner; walls are at 0, `width` and `depth`."""
    wood, cloth = _woods(rng), _cloth(rng)
    gap = _WALL / 2 + rng.uniform(0.01, 0.06)
    things: dict[str, Furniture] = {}

    def back(name: str, parts: Furniture, x: float, deep: float, z: float = 0.0) -> None:
        things[name] = _at(parts, x, gap + deep / 2, 0, z)

    def front(name: str, parts: Furniture, x: float, deep: float, z: float = 0.0) -> None:
        things[name] = _at(parts, x, depth - gap - deep / 2, 180, z)

    def left(name: str, parts: Furniture, y: float, deep: float, z: float = 0.0) -> None:
        things[name] = _at(parts, gap + deep / 2, y, -90, z)

    match kind:
        case "living":
            sofa, x = rng.uniform(1.7, 2.4), width * rng.uniform(0.45, 0.55)
            back("sofa", _sofa(sofa, cloth, rng), x, 0.9)
            low = _things_on(_table(1.0, 0.6, 0.4, wood), 0.4, 0.35, rng)
            things["coffee table"] = _at(low, x + rng.normal(0, 0.1), 1.75 + rng.uniform(0, 0.2), rng.normal(0, 4))
            things["armchair"] = _at(
                _armchair(_cloth(rng)), x - 1.25, 2.0 + rng.uniform(0, 0.3), -60 + rng.normal(0, 15)
            )
            things["armchair 2"] = _at(_armchair(_cloth(rng)), x + 1.3, 2.1, 65 + rng.normal(0, 15))
            board = [*cabinet((-0.8, -0.21, 0.0), (1.6, 0.4, 0.45), (3, 1), wood, plain(0.7, 0.6, 0.3))]
            front("television board", [*board, *_at(_television(rng), 0, 0, 0, 0.45)], x, 0.44)
            things["plant"] = _at(_tall_plant(rng), width - 0.45, 0.5, 0)
            things["lamp"] = _at(lamp(), 0.5 - 1.25, 0.5 - 0.3, 0)
            left("bookcase", _at(bookcase(0, 0.9, 1.75, _woods(rng), rng), 0, -0.14, 0), depth * 0.6, 0.28)
        case "dining":
            long, x, y = rng.uniform(1.3, 1.9), width / 2, depth / 2
            things["dining table"] = _at(_things_on(_table(long, 0.9, 0.74, wood), 0.74, 0.3, rng), x, y, 0)
            seats = [(i * long / 4 * 1.1, j * 0.62, 0 if j < 0 else 180) for i in (-1, 1) for j in (-1, 1)]
            for number, (dx, dy, angle) in enumerate(seats, 1):
                dx, dy = dx + rng.normal(0, 0.04), dy + np.sign(dy) * abs(rng.normal(0, 0.06))
                things[f"chair {number}"] = _at(_chair(cloth, wood), x + dx, y + dy, angle + rng.normal(0, 8))
            body = cabinet((-0.7, -0.22, 0.0), (1.4, 0.44, 0.85), (3, 2), _woods(rng), plain(0.75, 0.62, 0.3))
            back("sideboard", body, x, 0.48)
            things["plant"] = _at(_tall_plant(rng), 0.5, depth - 0.5, 0)
        case "bedroom":
            wide, y = rng.choice([0.95, 1.6]), depth * rng.uniform(0.42, 0.5)
            left("bed", _bed(wide, wood, rng), y, 2.05)
            for number, side in enumerate((-1, 1), 1):
                box = cabinet((-0.22, -0.2, 0.0), (0.44, 0.36, 0.5), (1, 2), wood, plain(0.3, 0.3, 0.3))
                stand = [Part((0, 0, 0.56), (0.14, 0.14, 0.12), plain(0.4, 0.3, 0.3), "ball")]
                shade = [Part((0, 0, 0.72), (0.24, 0.24, 0.2), plain(0.88, 0.84, 0.76), "cylinder")]
                left(f"nightstand {number}", [*box, *stand, *shade], y + side * (wide / 2 + 0.34), 0.45)
            drawers = cabinet((-0.5, -0.22, 0.0), (1.0, 0.44, 0.9), (1, 4), _woods(rng), plain(0.75, 0.62, 0.3))
            front("drawers", drawers, width * 0.6, 0.5)
            things["chair"] = _at(_chair(_cloth(rng), wood), width - 0.8, 0.8, 150 + rng.normal(0, 15))
        case "study":
            desk = _things_on(_table(1.4, 0.7, 0.74, wood), 0.74, 0.5, rng)
            back("desk", [*desk, *_at(_television(rng), 0, -0.15, 0, 0.74)], width / 2, 0.75)
            things["chair"] = _at(
                _chair(cloth, _woods(rng)), width / 2 + rng.normal(0, 0.1), 1.35, 180 + rng.normal(0, 12)
            )
            left("bookcase", _at(bookcase(0, 1.1, 1.9, _woods(rng), rng), 0, -0.14, 0), depth * 0.65, 0.28)
            carton = [Part((0, 0, 0.2), (0.55, 0.4, 0.4), plain(0.66, 0.5, 0.34, noise=0.02))]
            things["carton"] = _at(carton, width - 0.6, depth - 0.7, rng.uniform(0, 90))
            things["stool"] = _at(
                [*_legs(0.34, 0.34, 0.42, wood, 0.04), Part((0, 0, 0.44), (0.38, 0.38, 0.05), cloth, "cylinder")],
                width * 0.45,
                depth - 0.9,
                20,
            )
    return things


def make_flat(seed: int, count: int) -> Flat:
    """A flat of about so many Gaussians: two rows of two rooms, each of another kind."""
    rng = np.random.default_rng(seed)
    kinds = [str(kind) for kind in rng.permutation(["living", "dining", "bedroom", "study"])]
    widths, depths = rng.uniform(4.2, 5.6, 2), rng.uniform(4.0, 5.2, 2)
    shell, things = _walls(widths, depths, rng), dict[str, Furniture]()
    for number, kind in enumerate(kinds):
        column, row = number % 2, number // 2
        x, y = float(widths[:column].sum()), float(depths[:row].sum())
        floors = [
            grain(0.62, 0.43, 0.27, along=1, boards=0.14),
            plain(0.5, 0.42, 0.38, noise=0.04),
            checks((0.72, 0.69, 0.65), (0.6, 0.58, 0.55), 0.4),
        ]
        middle = (x + widths[column] / 2, y + depths[row] / 2)
        shell.append(Part((*middle, 0), (widths[column], depths[row], 0), floors[rng.integers(3)]))
        if kind in ("living", "bedroom"):
            rug = Part((middle[0], middle[1], 0.006), (2.0, 1.5, 0.01), plain(*rng.uniform(0.3, 0.8, 3), noise=0.04))
            shell.append(rug)
        for name, parts in _furnish(kind, float(widths[column]), float(depths[row]), rng).items():
            things[f"{kind} {name}"] = _at(parts, x, y, 0)
    low, high = _THINNED
    areas = [
        len(part.sample(high, np.random.default_rng(0))[0])
        for part in [*shell, *[part for parts in things.values() for part in parts]]
    ]
    spacing = max(low, high * float(np.sqrt(sum(areas) / count)))
    return _covered(shell, things, spacing, rng)


def _walls(widths: Float64Array, depths: Float64Array, rng: np.random.Generator) -> list[Part]:
    """Outer walls, inner walls with doorways, a ceiling, and a picture on each wall."""
    wide, deep = float(widths.sum()), float(depths.sum())
    paint = plain(*np.clip(np.array([0.84, 0.82, 0.78]) + rng.normal(0, 0.03, 3), 0, 0.95))
    parts = [Part((wide / 2, deep / 2, _HEIGHT), (wide, deep, 0), plain(0.88, 0.88, 0.87))]
    for y in (0.0, deep):
        parts.append(Part((wide / 2, y, _HEIGHT / 2), (wide, _WALL, _HEIGHT), paint))
    for x in (0.0, wide):
        parts.append(Part((x, deep / 2, _HEIGHT / 2), (_WALL, deep, _HEIGHT), paint))
    for axis, lengths, across in ((0, widths, float(depths[0])), (1, depths, float(widths[0]))):
        start = 0.0
        for length in lengths.tolist():
            door = start + length - 1.0
            spans = [(start, door - _DOOR_WIDTH / 2, 0.0), (door + _DOOR_WIDTH / 2, start + length, 0.0)]
            spans.append((door - _DOOR_WIDTH / 2, door + _DOOR_WIDTH / 2, _DOOR_HEIGHT))
            for first, last, foot in spans:
                size, centre = (
                    np.array([last - first, _WALL, _HEIGHT - foot]),
                    np.array([(first + last) / 2, across, (_HEIGHT + foot) / 2]),
                )
                order = [0, 1, 2] if axis == 0 else [1, 0, 2]
                parts.append(Part(tuple(centre[order]), tuple(size[order]), paint))
            start += length
    for number, x in enumerate((widths[0] / 2, widths[0] + widths[1] * 0.4)):
        frame = grain(0.28, 0.17, 0.1)
        parts += _at(picture(0, 1.6, 0.7, 0.5, frame, number + 1), float(x), _WALL / 2, 0)
    return parts


def _covered(shell: list[Part], things: dict[str, Furniture], spacing: float, rng: np.random.Generator) -> Flat:
    """Cover all surfaces with Gaussians, each body with a density of its own, and strew floaters in the air."""
    solid = [part for parts in things.values() for part in parts]
    points, normals, colours, spacings, owners = [], [], [], [], []
    bodies = [(part, 0) for part in shell]
    bodies += [(part, number) for number, parts in enumerate(things.values(), 1) for part in parts]
    for part, owner in bodies:
        own = spacing * rng.uniform(0.8, 1.2)
        where, facing = part.sample(own, rng)
        bodies_there = solid if owner == 0 else things[list(things)[owner - 1]]
        keep = ~_within(where, facing, [other for other in bodies_there if other is not part])
        where, facing = where[keep], facing[keep]
        shade = _shade(facing) * (_shadow(where, solid) if owner == 0 else 1)
        points.append(where + facing * rng.normal(0, 0.08 * own, (len(where), 1)))
        normals.append(facing)
        colours.append(part.texture(where) * shade[:, None] + rng.normal(0, 0.02, where.shape))
        spacings.append(own * np.exp(rng.normal(0, 0.2, len(where))))
        owners.append(np.full(len(where), owner))
    gaussians = discs(*(np.concatenate(each) for each in (points, normals, colours, spacings)))
    owner_of = np.concatenate(owners)
    gaussians = gaussians.replace(opacity_logits=rng.normal(_MEAN_LOGIT, 1.2, len(owner_of)))
    n = int(_FLOATERS * len(owner_of))
    low, high = gaussians.means.min(axis=0), gaussians.means.max(axis=0)
    stray = discs(
        rng.uniform(low, high, (n, 3)), _directions(n, rng), rng.uniform(0.2, 0.8, (n, 3)), np.full(n, 3 * spacing)
    )
    stray = stray.replace(opacity_logits=rng.normal(-2.5, 1, n))
    owner_of = np.concatenate([owner_of, np.zeros(n, np.int64)])
    return Flat(concatenate([gaussians, stray]), owner_of, shell, things, spacing)


def _within(points: Float64Array, facing: Float64Array, parts: Sequence[Part]) -> BoolArray:
    """Which points of surfaces lie in one of some boxes, (N,)."""
    within = np.zeros(len(points), np.bool_)
    for part in parts:
        within |= (part.shape == "box") & (part.distance(points + 1e-3 * facing) <= 0)
    return within


def _shade(facing: Float64Array) -> Float64Array:
    return np.asarray(0.72 + 0.28 * np.maximum(facing @ np.array([0.35, 0.3, 0.88]), 0))


def _shadow(points: Float64Array, parts: Sequence[Part]) -> Float64Array:
    """How bright walls and floor are near to things, (N,)."""
    distance = np.min([part.distance(points) for part in parts], axis=0)
    return np.asarray(1 - 0.5 * np.exp(-distance / 0.07))


def _directions(n: int, rng: np.random.Generator) -> Float64Array:
    vectors = rng.normal(size=(n, 3))
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


def _box(points: Float64Array) -> Float64Array:
    """Ends of a footprint on the plan, (2, 2)."""
    return np.asarray(np.percentile(points[:, :2], _ENDS, axis=0))


def _box_iou(first: Float64Array, second: Float64Array) -> float:
    common = np.prod(np.clip(np.minimum(first[1], second[1]) - np.maximum(first[0], second[0]), 0, None))
    return float(common / (np.prod(np.ptp(first, axis=0)) + np.prod(np.ptp(second, axis=0)) - common))


def main() -> None:
    """Print a line for each flat, and what was missed and what is false."""
    parser = parser_of(__doc__)
    parser.add_argument("output", type=Path, help="folder for plans")
    parser.add_argument("--seeds", nargs="+", type=int, default=[1, 2, 3], help="which flats")
    parser.add_argument("--counts", nargs="+", type=int, default=[400_000, 120_000], help="about how many Gaussians")
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True, exist_ok=True)
    for seed in arguments.seeds:
        for count in arguments.counts:
            _measure(make_flat(seed, count), arguments.output / f"flat{seed}_{count}.png")


def _measure(flat: Flat, picture: Path) -> None:
    start = time.process_time()
    found = find_objects(flat.gaussians, up="z")
    seconds = time.process_time() - start
    means = flat.gaussians.means.astype(np.float64)
    truth = [_box(means[flat.labels == number]) for number in range(1, len(flat.names) + 1)]
    sure = [one for one in found if one.confidence >= SURE and one.kind == "object"]
    boxes = [_box(means[found.labels == one.id]) for one in sure]
    ious = np.array([[_box_iou(each, box) for box in boxes] for each in truth]).reshape(len(truth), len(boxes))
    matched = dict[int, int]()
    for place in np.argsort(-ious, axis=None).tolist():
        thing, number = divmod(place, len(boxes)) if boxes else (0, 0)
        if ious[thing, number] >= _MIN_FOOTPRINT_IOU and thing not in matched and number not in matched.values():
            matched[thing] = number
    shares = []
    for thing, number in matched.items():
        is_thing, is_found = flat.labels == thing + 1, found.labels == sure[number].id
        shares.append((is_thing & is_found).sum() / (is_thing | is_found).sum())
    print(
        f"{picture.stem}: {len(flat.gaussians):,} Gaussians, found {len(matched)} of {len(truth)}, "
        f"{len(sure) - len(matched)} false, mean IoU of Gaussians {100 * np.mean(shares or [0]):.1f}, "
        f"{seconds:.0f} s of processor",
        flush=True,
    )
    print("  missed:", ", ".join(name for thing, name in enumerate(flat.names) if thing not in matched))
    false = [one for number, one in enumerate(sure) if number not in matched.values()]
    print("  false:", "; ".join(f"{one.id} at {one.centre.round(1)} size {one.size.round(1)}" for one in false))
    write_picture(draw_plan(found), picture)


if __name__ == "__main__":
    main()
