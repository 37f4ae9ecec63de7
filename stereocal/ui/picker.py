"""A photograph with zoom, pan and marks; clicks return image coordinates."""

from __future__ import annotations

import base64
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import streamlit as st

NAME = "stereocal_picker"
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
    """circle or diamond."""


@dataclass(frozen=True)
class Shown:
    """A photograph as sent to the browser."""

    id: str
    """Identifies the photograph; a click returns it."""
    source: str
    """A data URL."""
    width: int
    height: int
    """Of the original photograph."""


@dataclass(frozen=True)
class Pick:
    """A click, in pixels with the centre of the top-left pixel at (0, 0)."""

    id: str
    u: float
    v: float
    raw: bool
    """The shift key was held."""


def encode(image: npt.NDArray[np.uint8], name: str) -> Shown:
    """A photograph, grey or in colours, for `pick`; `name` must be unique."""
    height, width = image.shape[:2]
    if width * height > MOST_PIXELS:
        shrink = math.sqrt(MOST_PIXELS / (width * height))
        size = max(1, int(width * shrink)), max(1, int(height * shrink))
        image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
    done, content = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    assert done  # an 8-bit array
    source = "data:image/jpeg;base64," + base64.b64encode(content.tobytes()).decode()
    return Shown(name, source, width, height)


def pick(
    shown: Shown,
    marks: Sequence[Mark],
    label: str,
    key: str,
    locked: bool,
    on_pick: Callable[[Pick], None],
) -> None:
    """Show a photograph; a click calls `on_pick` before the page is drawn again.

    Args:
        label: description for screen readers.
        locked: clicks do nothing.
    """

    def picked() -> None:
        found = pick_of(st.session_state[key].get("picked"))
        if found is not None:
            on_pick(found)

    _component()(
        key=key,
        data={
            "id": shown.id,
            "source": shown.source,
            "width": shown.width,
            "height": shown.height,
            "marks": [asdict(mark) for mark in marks],
            "label": label,
            "locked": locked,
        },
        on_picked_change=picked,
    )


def pick_of(sent: Any) -> Pick | None:
    """The click that the browser sent; None if it is invalid."""
    try:
        found = Pick(str(sent["id"]), float(sent["u"]), float(sent["v"]), sent["raw"] is True)
    except (TypeError, KeyError, ValueError, OverflowError):
        return None
    return found if math.isfinite(found.u) and math.isfinite(found.v) else None


def _component() -> Any:
    # Declared in every run: tests have several runtimes.
    here = Path(__file__)
    return st.components.v2.component(
        NAME, html=HTML, css=_text(here.with_suffix(".css")), js=_text(here.with_suffix(".js"))
    )


@cache
def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8")
