"""A photograph with zoom, pan and marks; clicks return image coordinates."""

import base64
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import streamlit as st

from stereocal.detection.intensity import eight_bits
from stereocal.projects.files import StoredFile
from stereocal.system.array_types import FloatArray
from stereocal.system.latest import once
from stereocal.system.photograph import GreyImage, read_colours, read_photograph

NAME = "stereocal_picker"
KEYS = "Arrow keys and drags move, plus, minus, wheel and pinch zoom, Enter clicks at the cross."
JPEG_QUALITY = 90
MOST_PIXELS = 16_000_000
"""Larger photographs are reduced for the screen; coordinates stay those of the original."""
HTML = """
<div class="picker">
  <canvas tabindex="0" role="application"></canvas>
  <div class="tools" role="toolbar" aria-label="View">
    <button type="button" data-act="in" aria-label="Zoom in" title="Zoom in (+)">+</button>
    <button type="button" data-act="out" aria-label="Zoom out" title="Zoom out (-)">&minus;</button>
    <button type="button" data-act="fit" title="The whole photograph (0)">Fit</button>
    <button type="button" data-act="A" class="target" aria-label="Go to target A"
      title="Go to target A (a)">A</button>
    <button type="button" data-act="B" class="target" aria-label="Go to target B"
      title="Go to target B (b)">B</button>
    <output></output>
  </div>
</div>
"""


@dataclass(frozen=True)
class Mark:
    """A marked position in the photograph, in pixels."""

    letter: str
    u: float
    v: float
    sigma: float | None
    """Radius of the circle around it, drawn if large enough to be seen."""
    colour: str
    shape: str
    """circle or diamond, about a target; cross, or dashed where it is only proposed."""


@dataclass(frozen=True)
class Shown:
    """A photograph as sent to the browser: its id, a data URL, and the size of the original."""

    id: str
    """Identifies the photograph; a click returns it."""
    source: str
    width: int
    height: int


@dataclass(frozen=True)
class Pick:
    """A click, in pixels with the centre of the top-left pixel at (0, 0)."""

    id: str
    u: float
    v: float
    raw: bool
    """The shift key was held."""


def shown_image(coloured: bool, file: StoredFile, name: str) -> Shown:
    """A photograph for `pick`, grey or in colours."""
    return once(
        "picture to click in",
        f"{file.name} {coloured}",
        lambda: shown(file.name, eight_bits(read_image(coloured, file, name))),
    )


def shown(image_id: str, image: GreyImage, jpeg: bytes | None = None) -> Shown:
    """A picture for `pick`, of 8 bits.

    Args:
        jpeg: the same, encoded, if it is at hand.
    """
    height, width = image.shape[:2]
    if width * height > MOST_PIXELS:
        shrink = math.sqrt(MOST_PIXELS / (width * height))
        size = max(1, int(width * shrink)), max(1, int(height * shrink))
        reduced = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        image, jpeg = np.asarray(reduced, np.uint8), None
    if jpeg is None:
        done, content = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
        assert done  # an 8-bit array
        jpeg = content.tobytes()
    source = "data:image/jpeg;base64," + base64.b64encode(jpeg).decode()
    return Shown(image_id, source, width, height)


def read_image(coloured: bool, file: StoredFile, name: str) -> GreyImage:
    """A photograph, as `shown_image` shows it."""
    return read_colours(file, name) if coloured else read_photograph(file, name)


def pick(
    shown: Shown,
    marks: Sequence[Mark],
    label: str,
    key: str,
    locked: bool,
    on_pick: Callable[[Pick], None],
    lines: Sequence[tuple[FloatArray, str]] | None = None,
    placed: str = "",
) -> None:
    """Show a photograph; a click calls `on_pick` before the page is drawn again.

    Args:
        label: what it is, for screen readers; `KEYS` is added.
        locked: clicks do nothing.
        lines: curves over it, (n, 2) pixels, and their colours; then it has a magnifier, and no
            targets to go to.
        placed: what a click places. A text field in which it was just named passes on its keys.
    """

    def picked() -> None:
        click = pick_of(st.session_state[key].get("picked"))
        if click is not None:
            on_pick(click)

    curves = [{"points": points.tolist(), "colour": colour} for points, colour in lines or ()]
    drawn = {"marks": [*map(asdict, marks)], "lines": curves}
    kind = {"label": f"{label} {KEYS}", "locked": locked, "targets": lines is None, "about": placed}
    sent = {**asdict(shown), **drawn, **kind}
    # Declared in every run: tests have several runtimes.
    css, js = (_text(Path(__file__).with_suffix(suffix)) for suffix in (".css", ".js"))
    component = st.components.v2.component(NAME, html=HTML, css=css, js=js)
    component(key=key, data=sent, on_picked_change=picked)


def pick_of(sent: Any) -> Pick | None:
    """The click that the browser sent; None if it is invalid."""
    try:
        click = Pick(str(sent["id"]), float(sent["u"]), float(sent["v"]), sent["raw"] is True)
    except (TypeError, KeyError, ValueError, OverflowError):
        return None
    return click if math.isfinite(click.u) and math.isfinite(click.v) else None


@cache
def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8")
