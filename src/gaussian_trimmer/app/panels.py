"""The controls beside the 3D view. They hold what is asked for; what is done with it is `controller.py`'s."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from gaussian_trimmer import formats
from gaussian_trimmer.app.documents import Snapshot, TrimChoices

TOOLS = ("Look around", "Click", "Box", "3D box", "Brush", "Three points: up")
LOOK, CLICK, BOX, BOX3D, BRUSH, POINTS = TOOLS
EFFECTS = {"Add": "add", "Remove": "remove", "Keep only": "intersect"}
PARTS = {"Both": "both", "Object": "object", "Background": "background"}
WHENS = {"Before": "before", "After": "after"}
UPS = ("Found", "+X", "-X", "+Y", "-Y", "+Z", "-Z")
AS_SCENE = "as the scene"
_HINTS = {
    LOOK: "Drag to turn, right-drag to move, wheel to come nearer.",
    CLICK: "Click on the object. Ctrl-click removes; clicks on what is wrong move the boundary.",
    BOX: "Drag a box around the object. Ctrl removes what the box means.",
    BOX3D: "Move the box by its arrows, set its size, then apply it.",
    BRUSH: "Click on a surface to add what is near; Ctrl removes. Drag the ball to paint along the surface.",
    POINTS: "Click three points of the ground.",
}
HELP = """
| key | |
|---|---|
| Esc / C / R / X / B | look, click, box (rectangle), 3D box, brush |
| Shift, Ctrl, Ctrl+Shift | add, remove, keep only, whatever is chosen |
| Ctrl+Z, Ctrl+Shift+Z | undo, redo |
| Ctrl+Shift+A | select nothing |
| Page Up / Down | larger, smaller brush |
| F | look at the selection |
| T | trim |
| 1 2 3 | both, object, background |
| Space | before / after |

Page keys stand in for SuperSplat's `[` and `]`, which viser cannot bind.
"""


class Panels:
    """All controls, made once and shared by all tabs."""

    def __init__(self, gui: Any, path: str, camera_path: str) -> None:
        self.status_text = "Open a scene."
        """The sentence at the top that is not about something that is going on."""
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
        return TrimChoices(self.recover.value, self.clean.value, self.fill.value, self.fit.value)

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
        set_options(self.active, [label(part.id, part.name) for part in now.objects])
        self.active.value = label(now.object.id, now.object.name)
        self.name.value, self.colour.value = now.object.name, now.object.colour
        self.counts.content = "\n".join([
            "| object | marks | selected | trimmed |", "|---|---|---|---|",
            *(
                f"| {escaped(part.name)} | {len(part.marks)} | {part.n_selected:,} | "
                f"{f'{len(part.result.object):,}' if part.result else '-'} |"
                for part in now.objects
            ),
        ])  # fmt: skip
        direction = " ".join(f"{value:.3f}" for value in now.up.direction)
        sure = f", confidence {now.up.confidence:.2f}" if now.up.confidence < 1 else ""
        self.up_text.content = f"Up is {direction} ({now.up.source}{sure})."

    def show_tool(self, tool: str) -> None:
        """Show the controls and the hint of a tool."""
        self.hint.content = _HINTS[tool]
        self.brush.visible = tool == BRUSH
        self.box_size.visible = self.box_apply.visible = tool == BOX3D

    def _make_scene(self, gui: Any, path: str, camera_path: str) -> None:
        self.path = gui.add_text("Scene", path, hint="A splat file on this computer, or the folder of a training.")
        self.camera_path = gui.add_text("Cameras", camera_path, hint="COLMAP folder, transforms.json or cameras.json.")
        self.open = gui.add_button("Open", icon="folder-open")
        gui.add_divider()
        self.up_text = gui.add_markdown("")
        self.up = gui.add_button_group("Up is", UPS)
        self.three_points = gui.add_button("Up by three clicks on the ground", icon="dots")
        self.up_shown = gui.add_checkbox("Show the up arrow", True)

    def _make_marks(self, gui: Any) -> None:
        self.tool = gui.add_dropdown("Tool", TOOLS, initial_value=LOOK)
        self.effect = gui.add_dropdown("It does", tuple(EFFECTS), initial_value="Add")
        self.hint = gui.add_markdown(_HINTS[LOOK])
        self.brush = gui.add_slider("Brush radius", 0.02, 2.0, 0.02, 0.3, visible=False)
        self.box_size = gui.add_vector3("Box size", (1.0, 1.0, 1.0), min=(0.0, 0.0, 0.0), step=0.001, visible=False)
        self.box_apply = gui.add_button("Apply the box", visible=False)
        self.history = gui.add_button_group("Step", ("Undo", "Redo", "Clear"))
        self.selection_path = gui.add_text("Selection", "", hint="A selection file of any kind, or saved marks.")
        self.load = gui.add_button("Load instead of marks", icon="file-import")
        with gui.add_folder("Objects"):
            self.counts = gui.add_markdown("")
            self.active = gui.add_dropdown("Marks go to", ("-",))
            self.name = gui.add_text("Name", "")
            self.colour = gui.add_rgb("Colour", (255, 140, 30))
            self.objects = gui.add_button_group("Object", ("Apply", "New", "Delete"))

    def _make_trim(self, gui: Any) -> None:
        self.recover = gui.add_checkbox("Take in what is attached", True)
        self.fit = gui.add_checkbox("Fit the outline", True)
        self.clean = gui.add_checkbox("Clean the background", True)
        self.fill = gui.add_checkbox("Close the hole below", False)
        self.trim = gui.add_button("Trim", icon="cut", color="green")
        self.summary = gui.add_markdown("")
        with gui.add_folder("Show"):
            self.part = gui.add_dropdown("What", tuple(PARTS), initial_value="Both")
            self.when = gui.add_dropdown("When", tuple(WHENS), initial_value="Before")
            self.colours = gui.add_checkbox("Colours of the objects", True)
            self.straddlers = gui.add_checkbox("Straddlers (magenta)", False)
            self.unchecked = gui.add_checkbox("Not checked (yellow)", False)
            self.views = gui.add_checkbox("Virtual cameras", False)

    def _make_save(self, gui: Any) -> None:
        self.folder = gui.add_text("Folder", "", hint="New or empty, or with earlier results that may be replaced.")
        endings = (AS_SCENE, *(name.lstrip(".") for name in formats.FORMATS))
        self.format = gui.add_dropdown("Format", endings, initial_value=AS_SCENE)
        self.overwrite = gui.add_checkbox("Replace earlier results", False)
        self.save = gui.add_button("Save the object", icon="device-floppy")
        self.save_all = gui.add_button("Trim and save all objects", icon="stack-2")
        self.command = gui.add_markdown("")


def label(number: int, name: str) -> str:
    """How an object is listed; numbers stay when names change."""
    return f"{number}: {name}"


def set_options(dropdown: Any, options: Sequence[str]) -> None:
    """Give a list other entries, if they are others."""
    if tuple(dropdown.options) != tuple(options):
        dropdown.options = tuple(options)


def escaped(text: str) -> str:
    """Text that Markdown shows as it is."""
    return "".join(f"\\{character}" if character in "\\`*_{}[]()<>#|!~$" else character for character in text)
