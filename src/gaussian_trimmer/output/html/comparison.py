"""Figures of which two pictures at a time lie above each other, with a slider between them."""

from __future__ import annotations

import base64
from collections.abc import Sequence

import cv2

from gaussian_trimmer.output.html.document import text
from gaussian_trimmer.output.html.figures import Figure, Pairing
from gaussian_trimmer.output.pictures import Picture

_JPEG_QUALITY = 85


def comparison(name: str, figures: Sequence[Figure], pairings: Sequence[Pairing]) -> str:
    """Figures with a slider each, and a choice of what they compare if there are several pairings.

    Args:
        name: distinguishes the element from others of the page.
        figures: the figures, each with the pictures of all pairings; others are left out.
        pairings: what can be compared.
    """
    choices = ""
    if len(pairings) > 1:
        buttons = "".join(
            f'<label><input type="radio" name="{name}" value="{i}"{" checked" if i == 0 else ""}'
            f' data-left="{text(pairing.left)}" data-right="{text(pairing.right)}"> {text(pairing.title)}</label>'
            for i, pairing in enumerate(pairings)
        )
        choices = f'<fieldset class="choice"><legend>Compare</legend>{buttons}</fieldset>'
    notes = "".join(
        f'<p class="note" data-pairing="{i}"{" hidden" if i else ""}>{text(pairing.note)}</p>'
        for i, pairing in enumerate(pairings)
        if pairing.note
    )
    layers = {layer for pairing in pairings for layer in (pairing.left, pairing.right)}
    drawn = "".join(_figure(figure, layers, pairings[0]) for figure in figures)
    return f'<div class="comparison">{choices}{notes}<div class="figures">{drawn}</div></div>'


def _figure(figure: Figure, layers: set[str], first: Pairing) -> str:
    height, width = figure.pictures[first.left].shape[:2]
    images = "".join(
        f'<img src="{_data_uri(picture)}" alt="{text(f"{figure.caption}: {layer}")}" data-layer="{text(layer)}"'
        f' width="{width}" height="{height}" draggable="false"'
        f"{_side(layer, first)}>"
        for layer, picture in figure.pictures.items()
        if layer in layers
    )
    doubt = f' <strong class="bad">{text(figure.doubt)}</strong>' if figure.doubt else ""
    return (
        f'<figure class="{"doubtful" if figure.doubt else "sound"}"><div class="pair" style="aspect-ratio: '
        f'{width} / {height}">{images}<span class="edge" aria-hidden="true"></span>'
        f'<span class="name left" aria-hidden="true">{text(first.left)}</span>'
        f'<span class="name right" aria-hidden="true">{text(first.right)}</span>'
        f'<input type="range" min="0" max="100" value="50" aria-label="{text(figure.caption)}: how much of the left '
        f'picture is shown"></div><figcaption>{text(figure.caption)}{doubt}</figcaption></figure>'
    )


def _side(layer: str, pairing: Pairing) -> str:
    if layer == pairing.left:
        return ' class="left"'
    return ' class="right"' if layer == pairing.right else " hidden"


def _data_uri(picture: Picture) -> str:
    """An address that holds the picture itself."""
    done, data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    assert done, "OpenCV writes JPEG"
    return f"data:image/jpeg;base64,{base64.b64encode(data.tobytes()).decode('ascii')}"
