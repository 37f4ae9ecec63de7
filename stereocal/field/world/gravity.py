"""The measured gravity: a check of the scale in which no bar had a part, in words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from stereocal.system.numbers import rounded

STANDARD = 9.81
ON_EARTH = (9.764, 9.834)
"""Lowest and highest on the ground: on a high mountain near the equator, and at the poles."""
MOST_FRAMES_LATE = 3.0
"""An offset between the cameras beyond this number of frames is not suggested."""


@dataclass(frozen=True)
class Gravity:
    """|g| in m/s^2, with its 95 % interval."""

    value: float
    low: float
    high: float
    frame_rate: float
    with_drag: bool
    """Whether the air's drag was fitted."""
    drag: tuple[float, float, float] | None = None
    """Per metre, with its 95 % interval: the deceleration over the speed squared."""
    without_drag: float | None = None
    """|g| fitted without drag."""
    per_frame: float | None = None
    """Change of |g| if the secondary's frames were taken one frame later."""

    @property
    def agrees(self) -> bool:
        """Whether the interval reaches the gravity of any place on Earth."""
        return self.low <= ON_EARTH[1] and self.high >= ON_EARTH[0]

    @property
    def sentence(self) -> str:
        """The measured gravity and what it says."""
        verdict = "agrees with" if self.agrees else "disagrees with"
        return (
            f"Gravity is measured as {self.value:.2f} m/s² ({self.low:.2f} to {self.high:.2f}), "
            f"which {verdict} {STANDARD}."
        )

    def to_json(self) -> dict[str, Any]:
        """The entry `gravity` of `world.json`."""
        content: dict[str, Any] = {
            "m_per_s2": {"value": self.value, "low": self.low, "high": self.high},
            "expected": STANDARD,
            "agrees": self.agrees,
            "frame_rate": self.frame_rate,
            "drag_fitted": self.with_drag,
        }
        if self.drag is not None:
            value, low, high = self.drag
            content["drag_per_m"] = {"value": value, "low": low, "high": high}
        if self.without_drag is not None:
            content["m_per_s2_without_drag"] = self.without_drag
        return content


def drag_words(found: Gravity) -> tuple[str, ...]:
    """Whether the residuals call for drag."""
    if found.drag is None:
        return ()
    value, low, high = found.drag
    figure = f"{rounded(value)} per metre ({rounded(low)} to {rounded(high)})"
    if high < 0:
        return (
            f"The object gains speed along its way (drag {figure}), which no free flight does: "
            "frames with the object in a hand, or numbers of frames that skip?",
        )
    if low <= 0:
        text = f"The residuals show no drag: {figure}."
        if found.with_drag:
            return (text + " Drag was fitted all the same, since it may be too small to see.",)
        return (text,)
    without = "" if found.without_drag is None else f", g would be {found.without_drag:.2f} m/s²"
    if found.with_drag:
        return (f"The residuals show drag: {figure}. Without it{without}.",)
    return (f"The residuals show drag, {figure}: fit it, or the vertical leans.",)


def difference_words(found: Gravity) -> tuple[str, ...]:
    """What a gravity other than 9.81 would mean."""
    if found.agrees:
        off = max(found.high / ON_EARTH[0] - 1, 1 - found.low / ON_EARTH[1])
        return (
            f"Lengths are right within {100 * off:.1f} %, if the frame rate is; the bar had no "
            "part in this.",
        )
    ratio = found.value / STANDARD
    rate = found.frame_rate / np.sqrt(ratio)
    text = (
        f"Either lengths are {100 * abs(ratio - 1):.1f} % too {'long' if ratio > 1 else 'short'} "
        f"(bar or baseline), or the cameras took {rounded(rate, 4)} frames per second instead of "
        f"{rounded(found.frame_rate, 4)}"
    )
    if found.per_frame:
        late = (found.value - STANDARD) / found.per_frame
        if abs(late) <= MOST_FRAMES_LATE:
            when = "later" if late > 0 else "earlier"
            text += f", or the secondary took each frame {rounded(abs(late))} frames {when}"
    return (text + "; gravity alone cannot tell which.",)
