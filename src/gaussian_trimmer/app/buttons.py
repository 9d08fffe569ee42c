"""Choices and switches as rows of buttons. Unlike dropdowns and tick boxes, they leave all keys to the app."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

_ON_SIGN, _OFF_SIGN = "\u25cf ", "\u25cb "


class Switches:
    """Buttons each of which is on or off, as their labels show."""

    def __init__(
        self, gui: Any, label: str, options: Sequence[str], on: Iterable[str] = (), *, visible: bool = True
    ) -> None:
        self.options, self._on, self._clicked = tuple(options), set(on), list[Callable[[Any], None]]()
        self._group = gui.add_button_group(label, self._labels(), visible=visible)
        self._group.on_click(self._click)

    @property
    def visible(self) -> bool:
        """Whether the buttons are shown."""
        return bool(self._group.visible)

    @visible.setter
    def visible(self, visible: bool) -> None:
        self._group.visible = visible

    def __getitem__(self, option: str) -> bool:
        return option in self._on

    def __setitem__(self, option: str, on: bool) -> None:
        self._show(self._on | {option} if on else self._on - {option})

    def on_click(self, clicked: Callable[[Any], None]) -> None:
        """Call a function with the event after a button was pressed."""
        self._clicked.append(clicked)

    def _labels(self) -> tuple[str, ...]:
        return tuple((_ON_SIGN if option in self._on else _OFF_SIGN) + option for option in self.options)

    def _show(self, on: set[str]) -> None:
        self._on = on
        if self._group.options != self._labels():
            self._group.options = self._labels()

    def _click(self, event: Any) -> None:
        self._press(str(event.target.value)[len(_ON_SIGN) :])
        for clicked in self._clicked:
            clicked(event)

    def _press(self, option: str) -> None:
        self[option] = not self[option]


class Choice(Switches):
    """Buttons of which one is on."""

    def __init__(self, gui: Any, label: str, options: Sequence[str], *, visible: bool = True) -> None:
        super().__init__(gui, label, options, options[:1], visible=visible)

    @property
    def value(self) -> str:
        """The option that is on."""
        (value,) = self._on
        return value

    @value.setter
    def value(self, option: str) -> None:
        self._show({option})

    def offer(self, options: Sequence[str], chosen: str) -> None:
        """Give other options."""
        self.options = tuple(options)
        self.value = chosen

    def _press(self, option: str) -> None:
        self.value = option
