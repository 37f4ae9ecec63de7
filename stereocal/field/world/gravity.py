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
            content["drag_per_m"] = dict(zip(("value", "low", "high"), self.drag, strict=True))
        if self.without_drag is not None:
            content["m_per_s2_without_drag"] = self.without_drag
        return content

    @property
    def notes(self) -> tuple[str, ...]:
        """Whether the residuals call for drag, and what a gravity other than 9.81 would mean."""
        return (*self._of_drag, self._of_scale)

    @property
    def _of_drag(self) -> tuple[str, ...]:
        if self.drag is None:
            return ()
        value, low, high = self.drag
        figure = f"{rounded(value)} per metre ({rounded(low)} to {rounded(high)})"
        if high < 0:
            return (
                f"The object gains speed along its way (drag {figure}), which no free flight does: "
                "frames with the object in a hand, or numbers of frames that skip?",
            )
        if low <= 0:
            fitted = " Drag was fitted all the same, since it may be too small to see."
            return (f"The residuals show no drag: {figure}.{fitted * self.with_drag}",)
        if not self.with_drag:
            return (f"The residuals show drag, {figure}: fit it, or the vertical leans.",)
        without = "" if self.without_drag is None else f", g would be {self.without_drag:.2f} m/s²"
        return (f"The residuals show drag: {figure}. Without it{without}.",)

    @property
    def _of_scale(self) -> str:
        if self.agrees:
            off = max(self.high / ON_EARTH[0] - 1, 1 - self.low / ON_EARTH[1])
            return (
                f"Lengths are right within {100 * off:.1f} %, if the frame rate is; the bar had no "
                "part in this."
            )
        ratio = self.value / STANDARD
        text = (
            f"Either lengths are {100 * abs(ratio - 1):.1f} % too "
            f"{'long' if ratio > 1 else 'short'} (bar or baseline), or the cameras took "
            f"{rounded(self.frame_rate / np.sqrt(ratio), 4)} frames per second instead of "
            f"{rounded(self.frame_rate, 4)}"
        )
        late = (self.value - STANDARD) / self.per_frame if self.per_frame else np.inf
        if abs(late) <= MOST_FRAMES_LATE:
            when = "later" if late > 0 else "earlier"
            text += f", or the secondary took each frame {rounded(abs(late))} frames {when}"
        return f"{text}; gravity alone cannot tell which."
