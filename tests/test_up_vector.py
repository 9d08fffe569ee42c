"""Up vectors of made scenes and cameras whose vertical is known, and of the benchmark's."""

from __future__ import annotations

import benchmark_data
import cv2
import numpy as np
import pytest
import toy

from gaussian_trimmer import sample
from gaussian_trimmer.camera_files import read_camera_set
from gaussian_trimmer.cameras import Camera, CameraSet, intrinsics, look_at
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.formats import read
from gaussian_trimmer.gaussians import Float64Array, Gaussians
from gaussian_trimmer.trimming.up_vector import GROUND_TRIES, find_up, up_from_cameras, up_from_ground_plane

Z = np.array([0.0, 0.0, 1.0])
TILT = cv2.Rodrigues(np.array([0.5, -0.9, 0.3]))[0]


def angle(a: Float64Array, b: Float64Array) -> float:
    return float(np.degrees(np.arccos(np.clip(a @ b / np.linalg.norm(a) / np.linalg.norm(b), -1, 1))))


def gaussians_at(centres: Float64Array) -> Gaussians:
    return toy.gaussians(centres, np.exp(-4), (0.5, 0.5, 0.5))


def box(n: int, low: tuple[float, ...], high: tuple[float, ...], seed: int = 0) -> Float64Array:
    return np.random.default_rng(seed).uniform(low, high, (n, 3))


def room(n_floor: int = 3000, n_wall: int = 3000) -> tuple[Gaussians, np.ndarray]:
    """A thing on a floor (z = 0) before a wall (x = 2), and which Gaussians are the thing."""
    parts = [box(n_floor, (-2, -2, -0.005), (2, 2, 0.005)), box(n_wall, (2, -2, 0), (2.01, 2, 2), 1)]
    parts += [box(800, (0, 0, 0), (0.3, 0.3, 0.6), 2), box(400, (-2, -2, -0.3), (2, 2, 2), 3)]
    rows = np.repeat([False, False, True, False], [len(part) for part in parts])
    return gaussians_at(np.concatenate(parts)), rows


def orbit(yaws: Float64Array, pitch: float, up: Float64Array = Z, roll: float = 0.0) -> list[Camera]:
    """Cameras around the origin, `pitch` degrees above the horizon of +z, carried along with the rotation to `up`."""
    frame = np.eye(3) if up is Z else TILT
    cameras = []
    for i, yaw in enumerate(np.radians(yaws)):
        p = np.radians(pitch + 10 * (i % 2))
        position = 3 * np.array([np.cos(yaw) * np.cos(p), np.sin(yaw) * np.cos(p), np.sin(p)])
        transform = look_at(frame @ position, np.zeros(3), frame @ Z)
        turn = np.eye(4)
        turn[:3, :3] = cv2.Rodrigues(np.array([0, 0, np.radians(roll * (-1) ** i)]))[0]
        cameras.append(Camera(turn @ transform, intrinsics(1.0, 64, 64), 64, 64))
    return cameras


def camera_set(cameras: list[Camera], up: Float64Array | None = None) -> CameraSet:
    return CameraSet(tuple(cameras), up, (True,) * len(cameras), False)


def test_order_of_evidence() -> None:
    scene, rows = room()
    cameras = orbit(np.arange(0, 360, 20), 30)
    stated = camera_set(cameras, np.array([0.0, 1.0, 0.0]))
    upside_down = camera_set(orbit(np.arange(0, 360, 20), 30, TILT @ Z))

    explicit = find_up(scene, stated, (0, 0, -3), rows)
    assert (explicit.direction.tolist(), explicit.source, explicit.confidence) == ([0, 0, -1], "given", 1)
    assert (found := find_up(scene, stated, None, rows)).source == "camera file"
    assert found.direction.tolist() == [0, 1, 0]
    assert (found := find_up(scene, upside_down)).source == "camera axes"
    assert angle(found.direction, TILT @ Z) < 0.1
    assert (found := find_up(scene)).source == "ground plane"
    assert angle(found.direction, Z) < 0.5
    cloud = find_up(gaussians_at(box(2000, (-1, -1, -1), (1, 1, 1))))
    assert (cloud.direction.tolist(), cloud.source, cloud.confidence) == ([0, -1, 0], "default", 0)


@pytest.mark.parametrize("given", [(0, 0, 0), (np.nan, 0, 1), (np.inf, 0, 0), (0, 1), ((0, 0, 1),) * 3])
def test_impossible_given_vector(given: tuple[float, ...]) -> None:
    with pytest.raises(InputError, match="three finite numbers"):
        find_up(room()[0], given=given)


def test_what_was_found_before_keeps_its_confidence() -> None:
    found = find_up(room()[0], given=(0, 0, 2, 0.5))
    assert (found.direction.tolist(), found.source, found.confidence) == ([0, 0, 1], "found before", 0.5)
    assert found.for_trims() == (0, 0, 1, 0.5)
    with pytest.raises(InputError, match="a confidence, from 0 to 1"):
        find_up(room()[0], given=(0, 0, 1, 2))


@pytest.mark.parametrize("length", [1e-300, 1e300])
def test_given_vector_of_any_length(length: float) -> None:
    assert find_up(room()[0], given=(0, length, 0)).direction.tolist() == [0, 1, 0]


@pytest.mark.parametrize("yaws", [np.arange(0, 360, 30), np.arange(0, 180, 15), np.arange(0, 60, 6)])
@pytest.mark.parametrize("up", [Z, TILT @ Z])
def test_part_of_an_orbit_is_enough(yaws: Float64Array, up: Float64Array) -> None:
    found = up_from_cameras(orbit(yaws, 35, up))
    assert found is not None and found.source == "camera axes"
    assert angle(found.direction, up) < 0.1 and found.confidence > 0.95


def test_shaky_orbit() -> None:
    found = up_from_cameras(orbit(np.arange(0, 180, 15), 35, roll=4))
    steady = up_from_cameras(orbit(np.arange(0, 180, 15), 35))
    assert found is not None and steady is not None
    assert angle(found.direction, Z) < 3 and found.confidence < steady.confidence - 0.05


def test_cameras_that_look_straight_down() -> None:
    cameras = [
        Camera(look_at(np.array([0, 0, 3.0]), np.zeros(3), np.array([np.cos(a), np.sin(a), 0])), np.eye(3), 8, 8)
        for a in np.radians(np.arange(0, 360, 30))
    ]
    found = up_from_cameras(cameras)
    assert found is not None and angle(found.direction, Z) < 0.1


def test_forward_facing_cameras_give_their_mean_up() -> None:
    found = up_from_cameras(orbit(np.arange(-3.0, 4.0), 0))
    assert found is not None and found.source == "mean camera up"
    assert angle(found.direction, Z) < 6  # the mean pitch of 4.3 degrees cannot be told
    single = up_from_cameras(orbit(np.zeros(1), 0))
    assert single is not None and single.confidence == 0


def test_cameras_rolled_at_random_tell_nothing() -> None:
    rng = np.random.default_rng(0)
    cameras = []
    for _ in range(200):
        transform = np.eye(4)
        transform[:3, :3] = cv2.Rodrigues(rng.normal(size=3) * 3)[0]
        cameras.append(Camera(transform, np.eye(3), 8, 8))
    assert up_from_cameras(cameras) is None


def test_ground_plane_under_the_object_and_not_the_larger_wall() -> None:
    scene, rows = room(n_floor=2000, n_wall=6000)
    alone, on_ground = up_from_ground_plane(scene), up_from_ground_plane(scene, rows)
    assert alone is not None and angle(alone.direction, -np.array([1.0, 0, 0])) < 1
    assert on_ground is not None and angle(on_ground.direction, Z) < 0.5


def test_up_is_the_side_of_the_object() -> None:
    scene, rows = room()
    hanging = scene.replace(means=scene.means * np.float32([1, 1, -1]))
    found = up_from_ground_plane(hanging, rows)
    assert found is not None and angle(found.direction, -Z) < 0.5


def test_floor_goes_before_a_wall_across_x_with_about_as_many_gaussians() -> None:
    found = up_from_ground_plane(room(n_floor=3000, n_wall=3300)[0])
    assert found is not None and angle(found.direction, Z) < 0.5


def test_same_plane_every_time_and_in_any_order() -> None:
    scene, rows = room()
    first, again = up_from_ground_plane(scene, rows), up_from_ground_plane(scene, rows)
    order = np.random.default_rng(3).permutation(len(scene))
    shuffled = up_from_ground_plane(scene.select(order), rows[order])
    assert first is not None and again is not None and shuffled is not None
    assert (first.direction == again.direction).all() and first.confidence == again.confidence
    assert angle(first.direction, shuffled.direction) < 0.3


def test_transparent_gaussians_make_no_floor() -> None:
    floor, clouds = box(3000, (-1, -1, 0), (1, 1, 0)), box(3000, (-1, -1, -1), (1, 1, 1), 1)
    scene = gaussians_at(np.concatenate([floor, clouds, box(30_000, (-1, -1, -1), (1, 1, 1), 2)]))
    opacities = np.where(np.arange(len(scene)) < 6000, 5, -9).astype(np.float32)
    seen = up_from_ground_plane(scene.replace(opacity_logits=opacities))
    assert seen is not None and angle(seen.direction, Z) % 180 < 1
    assert up_from_ground_plane(scene) is None


@pytest.mark.parametrize("n", [1, 3, 60, 2000])
def test_degenerate_scenes_have_no_plane(n: int) -> None:
    assert up_from_ground_plane(gaussians_at(np.zeros((n, 3)))) is None
    line = np.outer(np.linspace(-1, 1, n), [1.0, 0.0, 0.0])
    assert up_from_ground_plane(gaussians_at(line)) is None
    scene, everything = gaussians_at(box(n, (0, 0, 0), (1, 1, 0))), np.ones(n, bool)
    assert up_from_ground_plane(scene, everything) is None


def test_object_of_no_gaussians_is_no_object() -> None:
    scene, rows = room()
    without, with_none = up_from_ground_plane(scene), up_from_ground_plane(scene, np.zeros_like(rows))
    assert without is not None and with_none is not None
    assert (without.direction == with_none.direction).all()


@pytest.mark.parametrize(
    ("name", "thing"), [("scene0", None), ("scene0", ("lantern", "three_views")), ("tabletop", ("robot", "dilated"))]
)
def test_benchmark_planes(name: str, thing: tuple[str, str] | None) -> None:
    scene = benchmark_data.benchmark_scene(name)
    found = up_from_ground_plane(scene.gaussians, None if thing is None else scene.coarse(*thing))
    assert found is not None and angle(found.direction, Z) < 0.5


def test_plane_of_a_real_capture() -> None:
    found = up_from_ground_plane(read(benchmark_data.find("real/seal.ply")))
    # Its vertical is known to about a degree.
    assert found is not None and angle(found.direction, np.array([0.0, -1, 0])) < 1.0


@pytest.mark.parametrize("name", ["scene0", "tabletop"])
def test_benchmark_cameras(name: str) -> None:
    cameras = read_camera_set(benchmark_data.find(name) / "cameras.json").cameras
    for part in (cameras, cameras[: len(cameras) // 4]):
        found = up_from_cameras(part)
        assert found is not None and angle(found.direction, Z) < 0.7


def test_below_a_part_of_an_object_the_ground_is_found_farther_out() -> None:
    parts = [box(3000, (-2, -2, -0.005), (2, 2, 0.005)), box(800, (0, 0, 0), (0.3, 0.3, 1.6), 2)]
    parts += [box(200, (0.1, 0.1, 1.6), (0.2, 0.2, 1.7), 3)]
    rows = np.repeat([False, False, True], [len(part) for part in parts])
    up = up_from_ground_plane(gaussians_at(np.concatenate(parts)), rows)
    assert up is not None and angle(up.direction, Z) < 1


def test_up_of_a_rug_is_where_things_stand_on_it() -> None:
    parts = [box(3000, (-2, -2, -0.005), (2, 2, 0.005)), box(500, (-0.5, -0.5, -0.012), (0.5, 0.5, -0.006), 1)]
    parts += [box(800, (0, 0, 0), (0.3, 0.3, 0.6), 2), box(200, (-2, -2, -0.3), (2, 2, 0), 3)]
    rows = np.repeat([False, True, False, False], [len(part) for part in parts])
    up = up_from_ground_plane(gaussians_at(np.concatenate(parts)), rows)
    assert up is not None and angle(up.direction, Z) < 1


def test_the_wall_of_a_picture_is_not_the_ground_of_a_room() -> None:
    parts = [
        box(12000, (-3, -3, 0), (3, 3, 0)),
        box(2000, (-3, 3, 0), (3, 3, 2)),
        box(300, (0, 2.98, 1), (0.8, 3, 1.6)),
    ]
    kinds = np.repeat([0, 1, 2], [len(part) for part in parts])
    scene = gaussians_at(np.concatenate(parts))
    scene.log_scales[kinds == 0, 2] -= 3  # flat, level
    scene.log_scales[kinds != 0, 1] -= 3  # flat, upright
    on_its_wall = up_from_ground_plane(scene, kinds == 2)
    assert on_its_wall is not None and angle(on_its_wall.direction, Z) > 80
    found = find_up(scene, None, None, kinds == 2)
    assert (found.source, angle(found.direction, Z) < 1) == ("floor", True)
    assert find_up(scene, None, None, kinds == 0).source != "floor"  # a rug keeps what was found beneath it


def test_the_ground_itself_has_the_up_vector_of_the_scene() -> None:
    scene, _ = room(n_wall=0)
    ground = np.abs(scene.means[:, 2]) < 0.006
    up = up_from_ground_plane(scene, ground)
    assert up is not None and angle(up.direction, Z) < 1


def test_far_planes_that_are_neither_upright_nor_level_are_no_ground() -> None:
    thing = box(400, (0, 0, 4.0), (0.3, 0.3, 4.3), 2)
    slope = box(800, (-3, -3, -0.005), (3, 3, 0.005)) @ cv2.Rodrigues(np.array([0.9, 0.0, 0.0]))[0].T
    cloud = box(2400, (-3, -3, -3), (3, 3, 3), 3)
    points = np.concatenate([thing, slope, cloud])
    rows = np.arange(len(points)) < len(thing)
    assert up_from_ground_plane(gaussians_at(points), rows) is None


def test_two_planes_that_agree_are_no_guess() -> None:
    scene = read(sample.SCENE)
    rows = np.load(sample.SELECTION)
    below, whole = up_from_ground_plane(scene, rows), up_from_ground_plane(scene, None, GROUND_TRIES)
    assert below is not None and whole is not None and not below.is_sure and not whole.is_sure
    found = find_up(scene, object_rows=rows)
    assert found.confidence == pytest.approx(below.confidence + whole.confidence) and found.doubt() is None
