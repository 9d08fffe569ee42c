"""The controls beside the 3D view. They hold what is asked for; others do it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from gaussian_trimmer import formats
from gaussian_trimmer.app.buttons import Choice, Switches
from gaussian_trimmer.app.edits import describe_up
from gaussian_trimmer.app.files import DOWNLOADS, OBJECT, WITHOUT, Target
from gaussian_trimmer.app.gestures import GestureChannel
from gaussian_trimmer.app.showing import Colouring, Part, Showing, When
from gaussian_trimmer.app.snapshots import Colour, MarkedObject, Snapshot, TrimChoices
from gaussian_trimmer.io.names import safe_file_name
from gaussian_trimmer.selecting.marks import Effect, Point, point_of

TOOLS = ("Look", "Click", "Box", "Lasso", "Polygon", "Brush", "3D box")
LOOK, CLICK, BOX, LASSO, POLYGON, BRUSH, BOX3D = TOOLS
POINTS = "Up by 3 points"
ADD, REMOVE, KEEP_ONLY = "Add", "Remove", "Keep only"
EFFECTS: dict[str, Effect] = {ADD: "add", REMOVE: "remove", KEEP_ONLY: "intersect"}
EVERYTHING = "Everything"
PARTS: dict[str, Part] = {EVERYTHING: "both", OBJECT: "object", WITHOUT: "background"}
WHENS: dict[str, When] = {"Before": "before", "After": "after"}
COLOURS: dict[str, Colouring] = {"Own": "own", "Objects": "objects", "Changes": "changes"}
BACKDROPS: dict[str, Colour | None] = {
    "Black": (0, 0, 0),
    "Grey": (119, 119, 119),
    "White": (255, 255, 255),
    "Checker": None,
}
SURFACE, THROUGH = "Surface", "Through"
FOOTPRINT, CENTRES = "Footprint", "Centres"
UPS: dict[str, Point | None] = {"Automatic": None} | {
    f"{sign}{name}": point_of(factor * axis)
    for name, axis in zip("XYZ", np.eye(3), strict=True)
    for sign, factor in (("+", 1.0), ("-", -1.0))
}
AS_SCENE = "as the scene"
WIPE = "Wipe"
VIEWS, ARROW = "Virtual cameras", "Up arrow"
UPRIGHT = "Upright at the origin"
KEEP, REPLACE = "Keep", "Replace"
_TAKE_ATTACHED, _FIT_OUTLINE = "Take in what is attached", "Fit the outline"
_CLEAN_BACKGROUND, _CONTINUE_SURFACE = "Clean the background", "Continue the surface"
HINTS = {
    LOOK: "Drag to turn, right-drag to move, wheel to zoom.",
    CLICK: "Click on the object. Ctrl-click removes. A click on a mistake moves the boundary.",
    BOX: "Drag a box around the object, or around a part of it to correct. Ctrl removes, Alt turns the view.",
    LASSO: "Draw around what is meant. Ctrl removes, Alt turns the view.",
    POLYGON: "Click corners, then on the first one or Enter. Ctrl removes, Alt turns the view.",
    BRUSH: "Paint. Ctrl removes, [ and ] change the size, Alt turns the view.",
    BOX3D: "Drag the box's faces by their arrows, and the box by the squares in it; then apply it.",
    POINTS: "Click three points on the ground.",
}
_WELCOME = "Cut one object out of a splat scene. Open a scene, or press 'Open' for the sample that is filled in."
PROGRAM_ENDED = (
    "The program has ended. Nothing on this page works any more. Start 'gaussian-trimmer view' again: what you have "
    "marked is kept, and is back when you open the scene."
)


class Panels:
    """All controls, made once and shared by all tabs."""

    def __init__(self, gui: Any, channel: GestureChannel, path: str, camera_path: str) -> None:
        self.status_text = _WELCOME
        """The sentence over the picture while nothing is going on."""
        self._channel, self._offered = channel, ""
        self._make_tools(gui)
        self.cut_out = gui.add_button("Cut out", icon="cut", color="green", hint="Trim the object and show it alone.")
        self._make_views(gui)
        self.history = gui.add_button_group("History", ("Undo", "Redo", "Clear"))
        tabs = gui.add_tab_group()
        with tabs.add_tab("File"):
            self._make_files(gui, path, camera_path)
        with tabs.add_tab("Objects"):
            self._make_objects(gui)
        with tabs.add_tab("Options"):
            self._make_options(gui)
        with tabs.add_tab("Save"):
            self._make_save(gui)
        with tabs.add_tab("Keys"):
            self.help = gui.add_markdown("")
        self.say(_WELCOME)

    @property
    def choices(self) -> TrimChoices:
        """The settings of the next trim."""
        on = self.options
        return TrimChoices(
            recover=on[_TAKE_ATTACHED], clean=on[_CLEAN_BACKGROUND], fill=on[_CONTINUE_SURFACE], fit=on[_FIT_OUTLINE]
        )

    @property
    def target(self) -> Target:
        """Where to save, and how."""
        folder = Path(self.folder.value.strip() or "trimmed").expanduser().absolute()
        return Target(folder, self.ending, self.existing.value == REPLACE)

    @property
    def ending(self) -> str | None:
        """The format of splat files; None: that of the scene."""
        return None if self.format.value == AS_SCENE else self.format.value

    @property
    def showing(self) -> Showing:
        """What is to be seen in the 3D view."""
        return Showing(PARTS[self.part.value], WHENS[self.when.value], COLOURS[self.colours.value])

    @showing.setter
    def showing(self, showing: Showing) -> None:
        for choice, options, value in (
            (self.part, PARTS, showing.part),
            (self.when, WHENS, showing.when),
            (self.colours, COLOURS, showing.colours),
        ):
            choice.value = next(name for name, meaning in options.items() if meaning == value)

    def start_afresh(self) -> None:
        """Forget what was chosen and entered for the scene before."""
        self.show_tool(LOOK)
        self.effect.value, self.reach.value, self.existing.value = ADD, SURFACE, KEEP
        self.taking.value = FOOTPRINT
        self.folder.value = self.selection_path.value = ""
        self.show_command("")

    def say(self, text: str, *, wrong: bool = False) -> None:
        """Show a sentence over the picture, now that nothing is going on."""
        self.status_text = text
        self._channel.show_status(text, wrong=wrong)

    def busy(self, doing: str, share: float) -> None:
        """Show what is being done, and how far it is, 0 to 1."""
        self._channel.show_status(f"{doing} ...", share)

    def refresh(self, now: Snapshot) -> None:
        """Show the names, numbers and settings of a state."""
        part = now.object
        names = [label(each) for each in now.objects]
        self.active.offer(names, names[now.active])
        if " ".join(self.name.value.split()) != part.name:  # otherwise somebody may be typing it
            self.name.value = part.name
        self.colour.value = part.colour
        self.kept["Hidden"], self.kept["Locked"] = part.hidden, part.locked
        self.up_text.content = describe_up(now.up)
        stem = now.document.path.name.split(".")[0]
        offered = str(Path("trimmed") / (stem if len(now.objects) == 1 else f"{stem}-{safe_file_name(part.name)}"))
        if self.folder.value in ("", self._offered):  # otherwise somebody has chosen another one
            self.folder.value = offered
        self._offered = offered

    def show_tool(self, tool: str) -> None:
        """Show the controls of a tool."""
        self.tool.value = tool
        self.brush.visible = tool == BRUSH
        self.reach.visible = self.taking.visible = tool in (BOX, LASSO, POLYGON, BRUSH)
        self.box_size.visible = self.box_apply.visible = tool == BOX3D

    def show_command(self, command: str) -> None:
        """Show the command that makes what was saved again, as text to copy; nothing if it is empty."""
        self.command.value, self.command.visible = command, bool(command)

    def _make_tools(self, gui: Any) -> None:
        self.tool = Choice(gui, "Tool", TOOLS)
        self.effect = Choice(gui, "Mode", tuple(EFFECTS))
        self.brush = gui.add_slider("Brush radius", 3, 200, 1, 24, visible=False)
        self.reach = Choice(gui, "Reach", (SURFACE, THROUGH), visible=False)
        self.taking = Choice(gui, "Take by", (FOOTPRINT, CENTRES), visible=False)
        self.box_size = gui.add_vector3("Box size", (1.0, 1.0, 1.0), min=(0.0, 0.0, 0.0), step=0.001, visible=False)
        self.box_apply = gui.add_button("Apply the box", visible=False)

    def _make_views(self, gui: Any) -> None:
        self.part = Choice(gui, "Show", tuple(PARTS))
        self.when = Choice(gui, "Trim", tuple(WHENS))
        self.compare = Switches(gui, "Compare", (WIPE,))
        self.colours = Choice(gui, "Colours", tuple(COLOURS))
        self.showing = Showing()
        self.backdrop = Choice(gui, "Backdrop", tuple(BACKDROPS))
        self.selection = gui.add_button_group("Selection", ("Grow", "Shrink", "Invert"))

    def _make_files(self, gui: Any, path: str, camera_path: str) -> None:
        self.upload = gui.add_upload_button("Choose a file, or drop one on the page", icon="upload")
        self.path = gui.add_text("Scene", path, hint="A splat file on this computer, or the folder of a training.")
        self.camera_path = gui.add_text("Cameras", camera_path, hint="COLMAP folder, transforms.json or cameras.json.")
        self.open = gui.add_button("Open", icon="folder-open")
        self.use_cameras = gui.add_button("Apply cameras to this scene", icon="camera", color="gray")
        self.save_project = gui.add_button("Download the project", icon="download", color="gray")
        gui.add_divider()
        self.up_text = gui.add_markdown("")
        self.up = gui.add_button_group("Up is", tuple(UPS))
        self.three_points = gui.add_button("Up by three clicks on the ground", icon="dots", color="gray")

    def _make_objects(self, gui: Any) -> None:
        self.active = Choice(gui, "Objects", ("-",))
        self.name = gui.add_text("Name", "")
        self.colour = gui.add_rgb("Colour", (255, 140, 30))
        self.kept = Switches(gui, "It is", ("Hidden", "Locked"))
        self.find_objects = gui.add_button(
            "Find objects", icon="search", hint="Mark everything that stands, hangs or leans in the scene."
        )
        self.objects = gui.add_button_group("Change", ("New", "Delete", "Show all"))
        self.selection_path = gui.add_text("Selection", "", hint="A selection file of any kind, or saved marks.")
        self.load = gui.add_button("Replace the marks by this file", icon="file-import", color="gray")

    def _make_options(self, gui: Any) -> None:
        options = (_TAKE_ATTACHED, _FIT_OUTLINE, _CLEAN_BACKGROUND, _CONTINUE_SURFACE)
        self.options = Switches(gui, "Cutting out", options, options)
        self.overlays = Switches(gui, "Also show", (VIEWS, ARROW))

    def _make_save(self, gui: Any) -> None:
        endings = (AS_SCENE, *(name.lstrip(".") for name in formats.FORMATS))
        self.format = Choice(gui, "Format", endings)
        self.placed = Switches(gui, "Place it", (UPRIGHT,))
        self.download = gui.add_button_group("Download", DOWNLOADS)
        gui.add_divider()
        self.folder = gui.add_text("Folder", "", hint="New or empty, or with earlier results that may be replaced.")
        self.existing = Choice(gui, "Earlier results", (KEEP, REPLACE))
        self.save = gui.add_button("Save in this folder", icon="device-floppy")
        self.save_all = gui.add_button("Cut out and save all objects", icon="stack-2")
        self.command = gui.add_text("The same by command", "", multiline=True, visible=False)


def label(part: MarkedObject) -> str:
    """Return how an object is listed; numbers stay when names change."""
    cut_out = f", {len(part.fresh.object):,} cut out" if part.fresh else ""
    return f"{part.id}: {part.name} ({part.n_selected:,}{cut_out})"
