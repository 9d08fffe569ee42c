"""The controls beside the 3D view. They hold what is asked for; `controller.py` does it."""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

from gaussian_trimmer import formats
from gaussian_trimmer.app.buttons import Choice, Switches
from gaussian_trimmer.app.display import Part, Showing, When
from gaussian_trimmer.app.documents import Snapshot, TrimChoices
from gaussian_trimmer.app.saving import Target
from gaussian_trimmer.planning.up_vector import UpVector

TOOLS = ("Look", "Click", "Box", "3D box", "Brush", "Up by 3 points")
LOOK, CLICK, BOX, BOX3D, BRUSH, POINTS = TOOLS
EFFECTS = {"Add": "add", "Remove": "remove", "Keep only": "intersect"}
PARTS = {"Both": "both", "Object": "object", "Background": "background"}
WHENS = {"Before": "before", "After": "after"}
UPS = ("Automatic", "+X", "-X", "+Y", "-Y", "+Z", "-Z")
AS_SCENE = "as the scene"
TINT, VIEWS, ARROW = "Tint", "Virtual cameras", "Up arrow"
_TAKE_ATTACHED, _FIT_OUTLINE = "Take in what is attached", "Fit the outline"
_CLEAN_BACKGROUND, _CONTINUE_SURFACE = "Clean the background", "Continue the surface"
_HINTS = {
    LOOK: "Drag to turn, right-drag to move, use the wheel to zoom.",
    CLICK: "Click on the object. Ctrl-click removes. A click on a mistake moves the boundary.",
    BOX: "Drag a box around the object. Ctrl-drag removes.",
    BOX3D: "Move the box by its arrows, set its size, then apply it.",
    BRUSH: "Click on a surface to add what is near it; Ctrl-click removes. Drag the ball to paint along the surface.",
    POINTS: "Click three points on the ground.",
}
ABOUT_OPENING = (
    "Everything that you have marked and trimmed in this scene will be lost for good. To only add cameras, choose *Use "
    "these cameras with the open scene*: that keeps your marks."
)
HELP = """
| key | |
|---|---|
| Esc / C / R / X / B | look, click, box, 3D box, brush |
| Shift, Ctrl, Ctrl+Shift | add, remove, keep only, whatever the panel says |
| Ctrl+Z, Ctrl+Shift+Z | undo, redo |
| Ctrl+Shift+A | clear the selection |
| Page Up, Page Down | larger, smaller brush |
| F | look at the selection, or at the whole scene |
| T | trim |
| 1 2 3 | both, object, background |
| Space | before / after |
| V | tint on / off |

Page Up and Page Down stand in for SuperSplat's `[` and `]`, which viser cannot bind.
"""


class Panels:
    """All controls, made once and shared by all tabs."""

    def __init__(self, gui: Any, path: str, camera_path: str) -> None:
        self.status_text = "Open a scene."
        """The sentence at the top while nothing is going on."""
        self.status = gui.add_markdown(self.status_text)
        self.progress = gui.add_progress_bar(0, visible=False, animated=True)
        self.cancel = gui.add_button("Cancel", color="red", visible=False)
        tabs = gui.add_tab_group()
        with tabs.add_tab("Scene"):
            self._make_scene(gui, path, camera_path)
        with tabs.add_tab("Mark"):
            self._make_marks(gui)
        with tabs.add_tab("Trim"):
            self._make_trim(gui)
        with tabs.add_tab("Save"):
            self._make_save(gui)
        with tabs.add_tab("Keys"):
            gui.add_markdown(HELP)

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
        format = None if self.format.value == AS_SCENE else self.format.value
        return Target(folder, format, self.existing.value == "Replace")

    @property
    def showing(self) -> Showing:
        """What is to be seen in the 3D view."""
        part, when = cast("Part", PARTS[self.part.value]), cast("When", WHENS[self.when.value])
        return Showing(part, when, self.overlays[TINT])

    def look_at_whole(self) -> None:
        """Show the whole scene before the trim, as marking begins."""
        self.part.value, self.when.value, self.overlays[TINT] = "Both", "Before", True

    def start_afresh(self, path: Path) -> None:
        """Show what belongs to a scene that was just opened."""
        self.look_at_whole()
        self.show_tool(LOOK)
        self.show_command("")
        self.folder.value = str(Path("trimmed") / path.name.split(".")[0])

    def say(self, text: str) -> None:
        """Show a sentence at the top."""
        self.status_text = text
        self.status.content = escaped(text)

    def busy(self, doing: str, share: float) -> None:
        """Show what is being done, and how far it is, 0 to 1; nothing if it is empty."""
        self.progress.visible = self.cancel.visible = bool(doing)
        self.progress.value = 100 * share
        if doing:
            self.status.content = escaped(f"{doing} ...")

    def refresh(self, now: Snapshot) -> None:
        """Show the names, numbers and settings of a state."""
        names = [label(part.id, part.name) for part in now.objects]
        self.active.offer(names, names[now.active])
        self.name.value, self.colour.value = now.object.name, now.object.colour
        rows = [
            f"| {escaped(part.name)} | {len(part.marks)} | {part.n_selected:,} | "
            f"{f'{len(part.result.object):,}' if part.result else '-'} |"
            for part in now.objects
        ]
        self.counts.content = "\n".join(["| object | marks | selected | trimmed |", "|---|---|---|---|", *rows])
        self.up_text.content = describe_up(now.up)
        self.summary.content = escaped(now.object.summary)

    def show_tool(self, tool: str) -> None:
        """Show the controls and the hint of a tool."""
        self.tool.value, self.hint.content = tool, _HINTS[tool]
        self.brush.visible = tool == BRUSH
        self.box_size.visible = self.box_apply.visible = tool == BOX3D

    def show_command(self, command: str) -> None:
        """Show the command that makes what was saved again, as text to copy; nothing if it is empty."""
        self.command.value, self.command.visible = command, bool(command)

    def _make_scene(self, gui: Any, path: str, camera_path: str) -> None:
        self.path = gui.add_text("Scene", path, hint="A splat file on this computer, or the folder of a training.")
        self.camera_path = gui.add_text("Cameras", camera_path, hint="COLMAP folder, transforms.json or cameras.json.")
        self.open = gui.add_button("Open", icon="folder-open")
        self.use_cameras = gui.add_button("Use these cameras with the open scene", icon="camera")
        gui.add_divider()
        self.up_text = gui.add_markdown("")
        self.up = gui.add_button_group("Up is", UPS)
        self.three_points = gui.add_button("Up by three clicks on the ground", icon="dots")

    def _make_marks(self, gui: Any) -> None:
        self.tool = Choice(gui, "Tool", TOOLS)
        self.effect = Choice(gui, "Mode", tuple(EFFECTS))
        self.hint = gui.add_markdown(_HINTS[LOOK])
        self.brush = gui.add_slider("Brush radius", 0.02, 2.0, 0.02, 0.3, visible=False)
        self.box_size = gui.add_vector3("Box size", (1.0, 1.0, 1.0), min=(0.0, 0.0, 0.0), step=0.001, visible=False)
        self.box_apply = gui.add_button("Apply the box", visible=False)
        self.history = gui.add_button_group("History", ("Undo", "Redo", "Clear"))
        with gui.add_folder("Objects"):
            self.counts = gui.add_markdown("")
            self.active = Choice(gui, "Marking", ("-",))
            self.name = gui.add_text("Name", "")
            self.colour = gui.add_rgb("Colour", (255, 140, 30))
            self.objects = gui.add_button_group("Object", ("Apply", "New", "Delete"))
        with gui.add_folder("Selection file", expand_by_default=False):
            self.selection_path = gui.add_text("File", "", hint="A selection file of any kind, or saved marks.")
            self.load = gui.add_button("Replace the marks by this file", icon="file-import")

    def _make_trim(self, gui: Any) -> None:
        options = (_TAKE_ATTACHED, _FIT_OUTLINE, _CLEAN_BACKGROUND, _CONTINUE_SURFACE)
        self.options = Switches(gui, "Options", options, options[:3])
        self.trim = gui.add_button("Trim", icon="cut", color="green")
        self.summary = gui.add_markdown("")
        with gui.add_folder("Show"):
            self.part = Choice(gui, "Part", tuple(PARTS))
            self.when = Choice(gui, "Trim", tuple(WHENS))
            self.overlays = Switches(gui, "Also", (TINT, VIEWS, ARROW), (TINT, ARROW))

    def _make_save(self, gui: Any) -> None:
        self.folder = gui.add_text("Folder", "", hint="New or empty, or with earlier results that may be replaced.")
        endings = (AS_SCENE, *(name.lstrip(".") for name in formats.FORMATS))
        self.format = Choice(gui, "Format", endings)
        self.existing = Choice(gui, "Earlier results", ("Keep", "Replace"))
        self.save = gui.add_button("Save the object", icon="device-floppy")
        self.save_all = gui.add_button("Trim and save all objects", icon="stack-2")
        self.command = gui.add_text("The same by command", "", multiline=True, visible=False)


def label(number: int, name: str) -> str:
    """How an object is listed; numbers stay when names change."""
    return f"{number}: {name}"


def describe_up(up: UpVector) -> str:
    """Which way is up and how that is known, in a sentence."""
    direction = " ".join(f"{value + 0.0:.3f}" for value in up.direction)
    if up.confidence == 0:
        return f"Up is unknown and assumed to be {direction}: choose an axis, or click three points on the ground."
    sure = f", confidence {up.confidence:.2f}" if up.confidence < 1 else ""
    return f"Up is {direction} ({up.source}{sure})."


def escaped(text: str) -> str:
    """Text that Markdown shows as it is."""
    return "".join(f"\\{character}" if character in "\\`*_{}[]()<>#|!~$" else character for character in text)
