"""Which modules may import which, read from the source: imports point one way."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import gaussian_trimmer

PACKAGE = Path(gaussian_trimmer.__file__).parent
FILES = ("formats", "camera_files", "selection_files")
"""Readers of files, each of which may also import those before it."""
BASE = (
    "settings", "errors", "_version", "io", "gaussians", "cameras", "parallel", "sample",
)  # fmt: skip
LAYERS = (
    BASE,
    ("geometry",),
    ("rendering",),
    FILES,
    ("views",),
    ("removal",),
    ("trimming",),
    ("masks",),
    ("output",),
    ("surface",),
    ("finding",),
    ("selecting",),
    ("parser",),
    ("evaluation",),
    ("app",),
    ("commands",),
    ("cli",),
    ("__main__", "__init__"),
)
"""Rooms of the package, callers last. A room imports from itself and from layers before its own; base modules, of which
each is one file, also from each other."""

NAME = re.compile(r"gaussian_trimmer(\.\w+)+(:\w+|\.)?")
"""A name of what the package imports late, or the beginning of one."""
HEAVY = ("torch", "transformers", "onnxruntime", "starlette", "uvicorn", "websockets", "ray")
"""Packages that take seconds to import or are not installed with the package itself."""


def modules() -> list[Path]:
    return sorted(path for path in PACKAGE.rglob("*.py"))


def room(path: Path) -> str:
    """The folder in the package's root that holds a file, or the file itself."""
    first = path.relative_to(PACKAGE).parts[0]
    return first.removesuffix(".py")


def imported_modules(tree: ast.AST) -> Iterator[str]:
    """Full names of what is imported anywhere in a module, late or not, or by a string."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            # What is imported from a package may be a module of it, or a name in it.
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Constant) and NAME.fullmatch(str(node.value)):
            yield str(node.value).partition(":")[0]


def imported_rooms(tree: ast.AST) -> set[str]:
    rooms = {name for layer in LAYERS for name in layer} | {room(path) for path in modules()}
    parts = [name.split(".") for name in imported_modules(tree)]
    return {part[1] for part in parts if part[0] == "gaussian_trimmer" and len(part) > 1 and part[1] in rooms}


def loaded_with(tree: ast.Module) -> Iterator[str]:
    """Names of the packages that are imported when a module is, not when one of its functions is called."""
    waiting: list[ast.AST] = [tree]
    while waiting:
        node = waiting.pop()
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)):
            continue
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            waiting += node.orelse
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module.split(".")[0]
        elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith("import_module") and node.args:
            yield ast.unparse(node.args[0]).strip("'\"").split(".")[0]
        waiting += ast.iter_child_nodes(node)


def may_import(importer: str, imported: str) -> bool:
    if importer == imported:
        return True
    if importer in BASE or imported in BASE:
        return imported in BASE
    if importer in FILES:
        return imported in ("geometry", *FILES[: FILES.index(importer)])
    layers = {name: number for number, layer in enumerate(LAYERS) for name in layer}
    return layers[imported] < layers[importer]


@pytest.fixture(scope="module")
def trees() -> dict[Path, ast.Module]:
    return {path: ast.parse(path.read_text(encoding="utf-8")) for path in modules()}


def test_every_room_has_a_layer() -> None:
    known = {name for layer in LAYERS for name in layer}
    assert {room(path) for path in modules()} <= known


def test_contributors_are_shown_the_rooms_in_this_order() -> None:
    page = Path(__file__).parents[1] / "CONTRIBUTING.md"
    if not page.is_file():
        pytest.skip("the project's files are not here")
    section = page.read_text(encoding="utf-8").split("## Where things are")[1].split("\n## ")[0]
    lines = [line.strip() for line in section.splitlines() if line.startswith("    ")]
    shown = [name for line in lines for name in line.split("  ")[0].split()]
    layers = {name: number for number, layer in enumerate(LAYERS) for name in layer}
    assert sorted([*shown, "_version", "__main__", "__init__"]) == sorted(layers)
    assert [layers[name] for name in shown] == sorted(layers[name] for name in shown)


def test_imports_point_one_way(trees: dict[Path, ast.Module]) -> None:
    wrong = [
        f"{path.relative_to(PACKAGE)} imports {imported}"
        for path, tree in trees.items()
        for imported in sorted(imported_rooms(tree))
        if not may_import(room(path), imported)
    ]
    assert wrong == []


def test_base_modules_do_not_import_each_other_in_a_circle(trees: dict[Path, ast.Module]) -> None:
    imports: dict[str, set[str]] = {}
    for path, tree in trees.items():
        if (name := room(path)) in BASE:
            imports.setdefault(name, set()).update(imported_rooms(tree) & set(BASE) - {name})
    while imports:
        free = [name for name, needed in imports.items() if not needed & imports.keys()]
        assert free, f"{sorted(imports)} import each other in a circle"
        imports = {name: needed for name, needed in imports.items() if name not in free}


def test_heavy_packages_are_imported_late(trees: dict[Path, ast.Module]) -> None:
    for path, tree in trees.items():
        assert not set(loaded_with(tree)) & set(HEAVY), path
