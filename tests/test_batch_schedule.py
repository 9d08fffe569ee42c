"""The scheduler of a batch: every item goes to one worker, scenes are read once where that can be, memory is kept."""

import random

import pytest

from gaussian_trimmer.batch.schedule import SceneItems, Schedule, shard_of


def scenes_of(*counts, need=1.0):
    first, found = 0, []
    for number, count in enumerate(counts):
        found.append(SceneItems(f"s{number}", list(range(first, first + count)), need))
        first += count
    return found


def test_a_worker_keeps_its_scene():
    schedule = Schedule(scenes_of(2, 3))
    assert schedule.take(0).items == [0, 1]
    assert schedule.take(1).scene == "s1"
    assert [schedule.next_item(0) for _ in range(3)] == [0, 1, None]
    assert [schedule.next_item(1) for _ in range(4)] == [2, 3, 4, None]
    assert schedule.take(0) is None
    assert schedule.scenes_taken == 2


def test_half_of_a_long_scene_goes_to_who_has_nothing():
    schedule = Schedule(scenes_of(7))
    schedule.take(0)
    assert schedule.take(1) is None  # until it is known which items are finished
    schedule.drop(0, {0})
    assert schedule.take(1).items == [4, 5, 6]
    assert schedule.items_of(0) == [1, 2, 3]
    assert schedule.waiting == 6


def test_items_of_the_dead_are_done_by_others():
    schedule = Schedule(scenes_of(3))
    schedule.take(0)
    assert schedule.next_item(0) == 0
    schedule.release(0)
    schedule.put_back("s0", [0])
    assert schedule.take(1).items == [1, 2]
    assert schedule.take(2).items == [0]


def test_memory_is_kept():
    schedule = Schedule([*scenes_of(1, 1, need=6.0), SceneItems("small", [2], 3.0)], budget=10.0)
    assert schedule.take(0).scene == "s0"
    assert schedule.take(1).scene == "small"
    assert schedule.take(2) is None
    schedule.next_item(0)
    assert schedule.holds_scene(0)
    schedule.release(0)
    assert schedule.take(2).scene == "s1"


@pytest.mark.parametrize("seed", range(20))
def test_every_item_is_done_once_whatever_dies(seed):
    rng = random.Random(seed)
    scenes = scenes_of(*(rng.randint(1, 9) for _ in range(6)), need=rng.choice([1.0, 4.0]))
    total = sum(len(entry.items) for entry in scenes)
    scene_of = {item: entry.scene for entry in scenes for item in entry.items}
    schedule, done, has_scene, doing = Schedule(scenes, budget=8.0), [], set(), {}
    for _ in range(10_000):
        worker = rng.randrange(4)
        if rng.random() < 0.05:
            schedule.release(worker)
            has_scene.discard(worker)
            if worker in doing:
                schedule.put_back(scene_of[doing[worker]], [doing.pop(worker)])
        elif worker in doing:
            done.append(doing.pop(worker))
        elif worker in has_scene and (item := schedule.next_item(worker)) is not None:
            doing[worker] = item
        elif (entry := schedule.take(worker)) is not None:
            schedule.drop(worker, set())
            has_scene.add(worker)
            assert {scene_of[item] for item in entry.items} == {entry.scene}
        else:
            schedule.release(worker)
            has_scene.discard(worker)
        if len(done) == total:
            break
    assert sorted(done) == list(range(total))


def test_shards_are_all_scenes_once_and_about_equal():
    scenes = scenes_of(*(1 + i * 7 % 13 for i in range(50)))
    shards = [shard_of(scenes, number, 4) for number in (1, 2, 3, 4)]
    assert sorted(entry.scene for shard in shards for entry in shard) == sorted(entry.scene for entry in scenes)
    loads = [sum(len(entry.items) for entry in shard) for shard in shards]
    assert max(loads) - min(loads) <= 2
    assert shard_of(scenes_of(1), 2, 2) == []
