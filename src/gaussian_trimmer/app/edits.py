"""Everything that changes the state: functions of a snapshot that return the next one, and what was done.

Each either does its work wholly or raises `InputError`, and nothing has changed.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from itertools import chain, count
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gaussian_trimmer import formats
from gaussian_trimmer.app.snapshots import PALETTE, MarkedObject, Progress, Similarity, Snapshot, TrimChoices
from gaussian_trimmer.cameras import Point, Viewpoint, point_of, up_frame
from gaussian_trimmer.errors import InputError
from gaussian_trimmer.finding.find import find_objects
from gaussian_trimmer.formats.identify import identify
from gaussian_trimmer.gaussians import BoolArray, FloatArray, Gaussians, concatenate, mask_of_rows, of_one_degree
from gaussian_trimmer.geometry.bounds import robust_bounds
from gaussian_trimmer.geometry.graphs import nearest
from gaussian_trimmer.output.engines import Placement
from gaussian_trimmer.rendering import top_contributors
from gaussian_trimmer.selecting.interpretation import INTERPRETATIONS
from gaussian_trimmer.selecting.marks import Click, Effect, FromFile, Mark, Marks, Rows, read_marks
from gaussian_trimmer.selection_files.row_matching import MATCH_NOTHING
from gaussian_trimmer.surface.overview import drawn_part
from gaussian_trimmer.surface.viewed_scene import CONTRIBUTORS
from gaussian_trimmer.trimming.result import TrimResult
from gaussian_trimmer.trimming.trim import trim
from gaussian_trimmer.trimming.up_vector import UpVector, find_up
from gaussian_trimmer.views.view import HALF

_MAX_NAME = 60
_GAP_SHARE = 0.1
"""Gap between a selection and what a click adds at its boundary, at most, relative to the selection's diagonal."""


class Change(NamedTuple):
    """What an edit makes of a snapshot."""

    after: Snapshot
    sentence: str
    """What was done, for the user."""


def mark(now: Snapshot, *marks: Mark, among: BoolArray | None = None, anew: bool = False) -> Change:
    """Mark the active object; what other objects have stays theirs, but a first click on one of them takes it from it.

    Args:
        now: the state before.
        marks: what to select, in order.
        among: Gaussians that may change, (N,), all if they are not given; those of objects that are locked or hidden
            never do. What else would change is put back by further marks.
        anew: in place of the marks before.

    Raises:
        InputError: a mark is not possible, it changes nothing, or after it nothing is selected.
    """
    now = clear(now).after if anew else now
    before = now.object
    if not before.n_selected and getattr(marks[0], "effect", "remove") != "add":
        raise InputError("Nothing is selected yet, so nothing can be removed or kept; mark with the mode 'Add' first.")
    selected = now.applied(before.selected, marks)
    how = selected.interpretations[-1]
    added = selected.mask & ~before.selected.mask
    strays = how == INTERPRETATIONS["region"] and added.any() and before.n_selected > 0
    if strays and not touches(now.document.scene.means, before.selected.mask, added):
        raise InputError("What you clicked on does not touch the object, so it was not added; draw over it to add it.")
    kept = now.locked if among is None else now.locked | ~among
    others = [part for part in now.objects if part is not before and not (part.locked or part.hidden)]
    source = None if before.n_selected else _clicked_on(now, others, marks[0])
    if source is not None:
        assert isinstance(marks[0], Click), "only a click is on another object"
        wanted = source.mask & ~now.applied(source.selected, [replace(marks[0], effect="remove")]).mask & ~kept
        how, stay = f"taken from {source.name}", ""
    else:
        wanted = np.where(kept, before.selected.mask, selected.mask)
        theirs = {part.name: added & wanted & part.mask for part in others}
        wanted = wanted & ~np.any([now.nothing().mask, *theirs.values()], axis=0)
        stay = " and ".join(f"{rows.sum():,} stay with {name}" for name, rows in theirs.items() if rows.any())
    undone: tuple[tuple[Effect, BoolArray], ...] = (
        ("remove", selected.mask & ~wanted),
        ("add", wanted & ~selected.mask),
    )
    for effect, rows in undone:
        if rows.any():
            settled = getattr(marks[0], "settled", False)
            marks = (*marks, Rows.of(rows, "what is not shown, or another object's, stays", effect, settled=settled))
            selected = now.applied(selected, marks[-1:])
    if stay and np.array_equal(selected.mask, before.selected.mask):
        raise InputError(f"This mark was not made: {stay}. To take them, add an object, and click on them first.")
    if not selected.mask.any():
        raise InputError("After this mark nothing would be selected, so it was not made. To start over, clear.")
    marked = before.marked(before.marks + marks, selected, further=True)
    change = _describe_change(before, marked)
    if not change:
        raise InputError(f"This mark changes nothing that is shown, so it was not made: {how}.")
    if not before.marks and before.colour in PALETTE:
        marked = replace(marked, colour=now.contrasting_colour(selected.mask))
    sentence = f"{change} {how}. {f'{stay}. ' if stay else ''}{marked.n_selected:,} Gaussians selected."
    after = now.with_object(marked, f"mark ({how})")
    return Change(after if source is None else after.with_object(_without(now, source, wanted), after.last), sentence)


def _clicked_on(now: Snapshot, parts: Sequence[MarkedObject], mark: Mark) -> MarkedObject | None:
    """Return that of some objects that has most of what shows where a mark clicks; None if none has, or it does not."""
    if not (isinstance(mark, Click) and isinstance(mark.view, Viewpoint) and parts):
        return None
    drawn, rows = drawn_part(now.document.scene, mark.view)
    found, weights = top_contributors(drawn, mark.view.camera, np.array([[mark.x, mark.y]]), CONTRIBUTORS)
    rows, shown = rows[found[0]], np.where(found[0] < 0, 0, weights[0])
    return next((part for part in parts if shown[part.mask[rows]].sum() > HALF * shown.sum()), None)


def _without(now: Snapshot, part: MarkedObject, rows: BoolArray) -> MarkedObject:
    """Return an object without some Gaussians, (N,), that another one has now."""
    taken = Rows.of(rows, "what another object has", "remove")
    selected = now.applied(part.selected, [taken])
    return (
        part.marked((*part.marks, taken), selected, further=True)
        if selected.mask.any()
        else part.marked((), now.nothing())
    )


def invert(now: Snapshot) -> Change:
    """Select what is not selected, except for what is locked, and nothing else. Raises as `mark`."""
    mask = now.object.selected.mask
    rest = Rows.of(~mask & ~now.locked, "inverted")
    return mark(now, rest, Rows.of(mask, "inverted", "remove")) if mask.any() else mark(now, rest)


def clear(now: Snapshot) -> Change:
    """Remove all marks of the active object."""
    return Change(now.with_object(now.object.marked((), now.nothing()), "clear"), "Cleared.")


def load(now: Snapshot, path: Path, *, whole: bool = False) -> Change:
    """Replace the active object's marks by a selection file of any kind, or by saved marks.

    With `whole`, all that it holds has to be in the scene.

    Raises:
        InputError: the file cannot be read, does not fit the scene, or selects nothing.
    """
    marks: tuple[Mark, ...] = (FromFile(path),)
    if identify(path).kind == "marks":
        given, n = read_marks(path), len(now.document.scene)
        if given.scene_size not in (None, n):
            raise InputError(
                f"These marks belong to a scene of {given.scene_size:,} Gaussians, and this one has {n:,}; open the "
                "scene in which they were made."
            )
        marks = given.marks
        if (other := understood_with(now, given)) is not now:
            now = other.understood_anew(now.last)
    selected = now.applied(now.nothing(), marks)
    if not selected.mask.any() or (whole and MATCH_NOTHING in selected.interpretations[-1]):
        raise InputError(f"'{path}' selects nothing in this scene.")
    loaded = now.object.marked(marks, selected)
    sentence = f"{loaded.n_selected:,} Gaussians selected: {'; '.join(selected.interpretations)}."
    return Change(now.with_object(loaded, "load a selection"), sentence)


def understood_with(now: Snapshot, marks: Marks) -> Snapshot:
    """Return the state with the up vector and the places of the pictures that some marks were made with."""
    places = marks.photographed_from or now.basis.photographed_from
    if (marks.up, places) == (now.basis.up, now.basis.photographed_from):
        return now
    up = now.up if marks.up == now.basis.up else UpVector(np.array(marks.up), "given", 1.0)
    return replace(now, up=up, basis=replace(now.basis, up=marks.up, photographed_from=places))


def use_cameras(now: Snapshot, path: Path) -> Change:
    """Give the scene cameras, and the up vector that they state unless it was given; marks are understood with them.

    Raises:
        InputError: the cameras cannot be read or are another scene's, or a mark is not possible with them.
    """
    document = now.document.with_cameras(path)
    up = now.up if now.up.source == "given" else document.find_up()
    after = replace(now, document=document, up=up, basis=document.basis(up)).understood_anew("cameras")
    return Change(after, "The scene has these cameras now; your marks are kept, and understood with them.")


def set_up(now: Snapshot, given: Point | None) -> Change:
    """Set the up vector, or find it if none is given; marks are understood anew with it.

    Raises:
        InputError: it is not a direction, or a mark is not possible with it.
    """
    up = now.document.find_up(given)
    basis = replace(now.document.basis(up), photographed_from=now.basis.photographed_from)
    return Change(replace(now, up=up, basis=basis).understood_anew("up vector"), describe_up(up))


def trim_object(
    now: Snapshot, choices: TrimChoices, progress: Progress = lambda stage: None, *, again: bool = False
) -> Change:
    """Trim the active object.

    Args:
        now: the state before.
        choices: settings.
        progress: called with the name of each stage when it begins.
        again: after further marks, as part of the step that made them.

    Raises:
        InputError: nothing is selected, or the trim is not possible.
    """
    part, document = now.object, now.document
    if not part.n_selected:
        raise InputError("Nothing is selected; mark an object first.")
    result = trim(
        document.scene,
        now.selection_of(part),
        config=choices.config(now.given_up),
        up=now.up if now.given_up else None,
        cameras=document.cameras,
        progress=progress,
    )
    result.made_later()  # now, while its progress can be seen
    part = replace(part, result=result, stale=False, together=False, choices=choices)
    if again:
        return Change(now.with_object(part, now.last), "Cut out again.")
    after = now.with_object(replace(part, before=None), "cut out")
    return Change(after, after.object.summary)


def keep_cuts(now: Snapshot, result: TrimResult) -> Change:
    """Let what all marked objects were trimmed to together be the cut-out of each."""
    parts, after = [part for part in now.objects if part.n_selected], now
    for part, trimmed in zip(parts, result.objects, strict=True):
        cut = replace(part, result=replace(result, objects=(trimmed,)), stale=False, together=True, before=None)
        after = after.with_object(replace(cut, choices=now.object.choices), "cut out and save all")
    return Change(after, after.sentence)


def take_out(now: Snapshot, choices: TrimChoices, progress: Progress = lambda stage: None) -> Change:
    """Cut the active object out, unless it is, and hide it, so that the scene without it is left. Raises as `trim`."""
    if now.object.fresh is None:
        now = trim_object(now, choices, progress).after
    taken = now.with_object(replace(now.object, hidden=True), "take out")
    return Change(taken, f"{now.object.name} is taken out of the scene; U shows it again, Ctrl+Z undoes.")


def add_object(now: Snapshot) -> Change:
    """Add an object and make it the active one."""
    nothing = now.nothing()
    added = MarkedObject(now.next_id, f"object {now.next_id}", now.contrasting_colour(nothing.mask), nothing)
    after = replace(now, objects=(*now.objects, added), active=len(now.objects), next_id=now.next_id + 1)
    return Change(replace(after, last="new object"), after.sentence)


def remove_object(now: Snapshot, number: int) -> Change:
    """Delete the object with this id.

    Raises:
        InputError: it is the only one.
    """
    if len(now.objects) == 1:
        raise InputError("This is the only object; clear its marks instead.")
    objects = tuple(part for part in now.objects if part.id != number)
    active = next((place for place, part in enumerate(objects) if part is now.object), len(objects) - 1)
    after = replace(now, objects=objects, active=active, last="delete object")
    return Change(after, after.sentence)


def activate(now: Snapshot, number: int) -> Change:
    """Mark the object with this id from now on.

    Raises:
        InputError: there is no such object.
    """
    after = replace(now, active=now.objects.index(now.part(number)))
    return Change(after, after.sentence)


def move(now: Snapshot, number: int, to: Similarity | None) -> Change:
    """Let the object with this id lie elsewhere in files; None: where it lies in the scene. Raises as `activate`."""
    part = now.part(number)
    if part.moved == to:
        return Change(now, now.sentence)
    said = f"{part.name} lies {'here in what is saved and downloaded' if to else 'as in the scene'}; Ctrl+Z undoes."
    return Change(now.with_object(replace(part, moved=to), "move"), said)


def add_scene(now: Snapshot, added: Gaussians, name: str, path: Path) -> Change:
    """Put another scene beside this one, upright and on its ground, as an object.

    Args:
        now: the state before.
        added: the other scene.
        name: the object's, unless another one has it.
        path: where both are kept, one after the other, from now on; nothing is there yet.

    Raises:
        InputError: the file cannot be written.
    """
    scene, up, n = now.document.scene, now.up.direction, len(now.document.scene)
    found = find_up(added, None)
    theirs = found.direction if found.is_sure else up  # a thing alone shows no ground
    here, there = (robust_bounds(each, up_frame(way)) for each, way in ((scene, up), (added, theirs)))
    aside = here.centre + here.axes[0] * (here.half_extents[0] + there.half_extents[0])
    foot = aside + here.axes[2] * (there.half_extents[2] - here.half_extents[2])
    turn = here.axes.T @ there.axes
    added = Placement(turn, there.centre - turn.T @ foot, 1.0).apply(added)
    both = concatenate(of_one_degree([scene, added])).replace(extras={})
    formats.write(both, path)
    document = replace(now.document, path=path, scene=both)
    rest = np.zeros(len(added), np.bool_)
    basis = replace(document.basis(now.up), photographed_from=now.basis.photographed_from)
    after = replace(now, document=document, basis=basis, last="add a scene")
    parts = []
    for part in now.objects:
        rows = (Rows.of(np.append(part.mask, rest), "as it was before a scene was added"),) if part.n_selected else ()
        parts.append(replace(part.marked(rows, after.applied(after.nothing(), rows)), before=None))
    rows = (Rows.of(np.arange(len(both)) >= n, "added"),)
    names, taken = chain([name], (f"{name} {number}" for number in count(2))), {part.name for part in parts}
    name = next(each for each in names if each not in taken)
    selected = after.applied(after.nothing(), rows)
    parts.append(MarkedObject(now.next_id, name, after.contrasting_colour(selected.mask), selected, rows))
    after = replace(after, objects=tuple(parts), active=len(parts) - 1, next_id=now.next_id + 1)
    return Change(after, f"{name} stands beside the scene: move it by 1, turn it by 2, scale it by 3.")


def describe(now: Snapshot, number: int, what: str, value: object) -> Change:
    """Give the object with this id a name or a colour, hide or lock it, or show and unlock it.

    Args:
        now: the state before.
        number: the object's id.
        what: "name", "colour", "hidden" or "locked".
        value: what it is to be; a colour as #rrggbb.

    Raises:
        InputError: there is no such object, it has no such thing, or a name is empty, too long, or another object's.
    """
    part = now.part(number)
    if what in ("hidden", "locked"):
        changed: dict[str, Any] = {what: value is True}
        after = now.with_object(replace(part, **changed), "hide or lock")
        return Change(after, f"{part.name} is hidden; U shows it." if what == "hidden" and value else after.sentence)
    text = " ".join(value.split()) if isinstance(value, str) else ""
    if what == "colour" and re.fullmatch("#[0-9a-f]{6}", text):
        red, green, blue = bytes.fromhex(text[1:])
        return Change(now.with_object(replace(part, colour=(red, green, blue)), "name or colour"), now.sentence)
    if what != "name":
        raise InputError(f"'{text}' cannot be a {what}.")
    check_name(text)
    if any(other.name == text and other is not part for other in now.objects):
        raise InputError(f"Another object is already called '{text}'.")
    after = now if text == part.name else now.with_object(replace(part, name=text), "name or colour")
    return Change(after, after.sentence)


def check_name(name: str) -> str:
    """Return a name that an object can have.

    Raises:
        InputError: it is empty, too long, or has characters that cannot be shown.
    """
    if not name or len(name) > _MAX_NAME or not name.isprintable():
        raise InputError(f"'{name}' cannot be a name: a name has 1 to {_MAX_NAME} printable characters.")
    return name


def show_all(now: Snapshot) -> Change:
    """Show all objects."""
    shown = tuple(replace(part, hidden=False) for part in now.objects)
    after = replace(now, objects=shown, last="show all")
    return Change(after, after.sentence)


def find(now: Snapshot, progress: Progress = lambda stage: None) -> Change:
    """Add an object for each one that is found without a mark.

    Objects that are marked already stay as they are, and keep their Gaussians; others make room. What the program is
    not sure of is left out.

    Raises:
        InputError: nothing is found that is sure and not marked yet, or hardly anything shows in the views.
    """
    document = now.document
    found = find_objects(document.scene, cameras=document.cameras, up=now.up.direction, progress=progress)
    kept, blank = ([part for part in now.objects if bool(part.marks) is marked] for marked in (True, False))
    taken = np.any([now.nothing().mask, *(part.mask for part in kept)], axis=0)
    sure = list(found.selections().values())
    further = [rows[~taken[rows]] for rows in sure if taken[rows].sum() <= HALF * len(rows)]
    left_out = {"unsure": len(found) - len(sure), "marked already": len(sure) - len(further)}
    rest = ", ".join(f"{many} {why}" for why, many in left_out.items() if many)
    rest = f" Left out: {rest}." if rest else ""
    if not further:
        raise InputError(f"No further object was found; mark by clicks or boxes.{rest}")
    new = (MarkedObject(free, f"object {free}", PALETTE[0], now.nothing()) for free in count(now.next_id))
    after = replace(now, objects=tuple(kept), active=len(kept), last="find objects")
    for part, found_rows in zip(chain(blank, new), further, strict=False):
        mask = mask_of_rows(found_rows, len(document.scene))
        rows = Rows.of(mask, "found")
        marked = part.marked((rows,), now.applied(now.nothing(), (rows,)))
        marked = replace(marked, colour=after.contrasting_colour(mask), hidden=False)
        after = replace(after, objects=(*after.objects, marked), next_id=max(after.next_id, part.id + 1))
    return Change(after, f"Found {len(further)} object{'s' * (len(further) > 1)}; the list has them.{rest}")


def describe_up(up: UpVector) -> str:
    """Say which way is up and how that is known."""
    direction = " ".join(f"{value + 0.0:.3f}" for value in up.direction)
    if up.confidence == 0:
        return f"Up is unknown and assumed to be {direction}: choose an axis, or click three points on the ground."
    sure = f", confidence {up.confidence:.2f}" if up.confidence < 1 else ""
    return f"Up is {direction} ({up.source}{sure})."


def normal_of(points: Sequence[Point], eye: Point) -> Point:
    """Return the normal of the plane through three points, towards an eye.

    Raises:
        InputError: the points lie in a line.
    """
    first, second, third = np.array(points, np.float64)
    normal = np.cross(second - first, third - first)
    size = max(float(np.linalg.norm(second - first)), float(np.linalg.norm(third - first)))
    if not np.linalg.norm(normal) > 1e-3 * size**2:
        raise InputError("The three points lie in a line; click three that span the ground.")
    if normal @ (np.array(eye) - first) < 0:
        normal = -normal
    return point_of(normal / np.linalg.norm(normal))


def touches(means: FloatArray, selected: BoolArray, added: BoolArray) -> bool:
    """Tell whether some Gaussians lie beside a selection, (N,) each, and not far from it in the scene."""
    size = float(np.linalg.norm(np.ptp(means[selected], axis=0)))
    squared, _ = nearest(means[selected], means[added], 1)
    return float(np.sqrt(squared.min())) <= _GAP_SHARE * size


def _describe_change(part: MarkedObject, marked: MarkedObject) -> str:
    """Say what a mark changed of an object; nothing if it changed nothing."""
    before, after = part.selected, marked.selected
    for had, has in ((part.mask, marked.mask), (before.mask, after.mask)):  # what is seen, or else what is selected
        added, removed = (int(np.count_nonzero(rows)) for rows in (has & ~had, had & ~has))
        if added and removed:
            return f"Added {added:,} and removed {removed:,}:"
        if added or removed:
            return f"Added {added:,}:" if added else f"Removed {removed:,}:"
    if len(after.cuts) > len(before.cuts):
        return "Cut:"
    if any(cut.spared.sum() > was.spared.sum() for cut, was in zip(after.cuts, before.cuts, strict=False)):
        return "Put back what was cut:"
    kept_out = int(np.count_nonzero(after.excluded_mask & ~before.excluded_mask))
    return f"Removed nothing that is selected; the trim will leave out {kept_out:,}:" if kept_out else ""
