"""Imports by name, made when what they name is first used: start-up stays quick, and a plug-in is one line of a table.

Names are written "package.module:attribute", in full, so that a search finds them; without an attribute the module
itself is meant.
"""

from __future__ import annotations

TYPE_CHECKING = False
if TYPE_CHECKING:  # at start-up, an import of these takes longer than what they are for
    from collections.abc import Callable, Mapping
    from typing import Any


def load(name: str) -> Any:
    """Import what a name stands for.

    >>> load("gaussian_trimmer.errors:InputError").__name__
    'InputError'
    """
    from importlib import import_module

    module, _, attribute = name.partition(":")
    loaded = import_module(module)
    return getattr(loaded, attribute) if attribute else loaded


def late_attributes(package: str, names: Mapping[str, str]) -> Callable[[str], Any]:
    """Return a module's `__getattr__` that imports its attributes when they are first asked for.

    Args:
        package: the module's `__name__`.
        names: what each attribute stands for, by its name.
    """

    def get_attribute(name: str) -> Any:
        import sys

        if name not in names:
            raise AttributeError(f"module '{package}' has no attribute '{name}'")
        value = load(names[name])
        setattr(sys.modules[package], name, value)
        return value

    return get_attribute
