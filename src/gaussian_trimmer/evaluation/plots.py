"""Plots as SVG, written out by hand: one needs no library for two curves."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape

_WIDTH, _HEIGHT = 520, 320
_LEFT, _RIGHT, _TOP, _BOTTOM = 76, 76, 34, 50
_MAX_TICKS = 5


@dataclass(frozen=True)
class Curve:
    """Points joined by lines, with an axis of their own."""

    label: str
    values: Sequence[float]
    """One for each x."""
    colour: str


def two_curves(title: str, x_label: str, xs: Sequence[float], left: Curve, right: Curve) -> str:
    """An SVG of two curves over the same x, the first with its axis on the left, the second on the right."""
    x_of = _scale(min(xs), max(xs), _LEFT + 16, _WIDTH - _RIGHT - 16)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {_HEIGHT}" font-family="sans-serif" '
        'font-size="12">',
        f'<rect width="{_WIDTH}" height="{_HEIGHT}" fill="white"/>',
        _text(_WIDTH / 2, 20, title, "middle", "#222", bold=True),
        _text(_WIDTH / 2, _HEIGHT - 10, x_label, "middle", "#222"),
        _line(_LEFT, _HEIGHT - _BOTTOM, _WIDTH - _RIGHT, _HEIGHT - _BOTTOM, "#222"),
    ]
    for x in xs:
        parts.append(_text(x_of(x), _HEIGHT - _BOTTOM + 18, f"{x:g}", "middle", "#222"))
    for curve, at, anchor, tick in ((left, _LEFT, "end", -6), (right, _WIDTH - _RIGHT, "start", 6)):
        parts += _axis(curve, at, anchor, tick)
        y_of = _vertical(curve)
        points = " ".join(f"{x_of(x):.1f},{y_of(y):.1f}" for x, y in zip(xs, curve.values, strict=True))
        parts.append(f'<polyline points="{points}" fill="none" stroke="{curve.colour}" stroke-width="2"/>')
        parts += [
            f'<circle cx="{x_of(x):.1f}" cy="{y_of(y):.1f}" r="3.5" fill="{curve.colour}"/>'
            for x, y in zip(xs, curve.values, strict=True)
        ]
    return "\n".join([*parts, "</svg>"]) + "\n"


def _axis(curve: Curve, at: float, anchor: str, tick: float) -> list[str]:
    low, high, step = _range(curve)
    y_of = _vertical(curve)
    marks = [_line(at, _TOP, at, _HEIGHT - _BOTTOM, curve.colour)]
    for i in range(round((high - low) / step) + 1):
        value = low + i * step
        marks.append(_line(at, y_of(value), at + tick / 2, y_of(value), curve.colour))
        marks.append(_text(at + tick, y_of(value) + 4, f"{value:g}", anchor, curve.colour))
    x, turn = (14, -90) if anchor == "end" else (_WIDTH - 14, 90)
    y = (_TOP + _HEIGHT - _BOTTOM) / 2
    marks.append(
        f'<text x="{x}" y="{y}" text-anchor="middle" fill="{curve.colour}" transform="rotate({turn} {x} {y})">'
        f"{escape(curve.label)}</text>"
    )
    return marks


def _range(curve: Curve) -> tuple[float, float, float]:
    """Lowest and highest value of an axis, zero among them, and the step between its ticks: round numbers."""
    low, high = min(0.0, *curve.values), max(0.0, *curve.values)
    rough = (high - low) / (_MAX_TICKS - 1) or 1.0
    unit = 10.0 ** math.floor(math.log10(rough))
    step = next(unit * factor for factor in (1, 2, 2.5, 5, 10) if unit * factor >= rough)
    return step * math.floor(low / step), step * max(1, math.ceil(high / step)), step


def _vertical(curve: Curve) -> Callable[[float], float]:
    low, high, _ = _range(curve)
    return _scale(low, high, _HEIGHT - _BOTTOM, _TOP)


def _scale(low: float, high: float, start: float, end: float) -> Callable[[float], float]:
    width = high - low or 1.0
    return lambda value: start + (end - start) * (value - low) / width


def _line(x0: float, y0: float, x1: float, y1: float, colour: str) -> str:
    return f'<line x1="{x0:.1f}" y1="{y0:.1f}" x2="{x1:.1f}" y2="{y1:.1f}" stroke="{colour}"/>'


def _text(x: float, y: float, text: str, anchor: str, colour: str, *, bold: bool = False) -> str:
    weight = ' font-weight="bold"' if bold else ""
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" fill="{colour}"{weight}>{escape(text)}</text>'
