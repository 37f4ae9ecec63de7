"""The measured gravity: a check of the scale in which no bar had a part, in words."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from stereocal.evaluation.summary import Estimate
from stereocal.system.numbers import rounded

STANDARD = 9.81
ON_EARTH = (9.764, 9.834)
"""Lowest and highest on the ground: on a high mountain near the equator, and at the poles."""
MOST_FRAMES_LATE = 3.0
"""An offset between the cameras beyond this number of frames is not suggested."""


@dataclass(frozen=True)
class Gravity:
    """The gravity of a throw, with 95 % intervals."""

    strength: Estimate
    """|g| in m/s^2."""
    frame_rate: float
    with_drag: bool
    """Whether the air's drag was fitted."""
    drag: Estimate | None
    """The deceleration over the speed squared, per metre."""
    without_drag: float | None
    """|g| fitted without drag."""
    per_frame: float | None
    """Change of |g| if the secondary's frames were taken one frame later."""

    @property
    def agrees(self) -> bool:
        """Whether the interval reaches the gravity of any place on Earth."""
        return self.strength.low <= ON_EARTH[1] and self.strength.high >= ON_EARTH[0]

    @property
    def sentence(self) -> str:
        """The measured gravity and what it says."""
        strength, verdict = self.strength, "agrees with" if self.agrees else "disagrees with"
        return (
            f"Gravity is measured as {strength.value:.2f} m/s² ({strength.low:.2f} to "
            f"{strength.high:.2f}), which {verdict} {STANDARD}."
        )

    def to_json(self) -> dict[str, Any]:
        """The entry `gravity` of `world.json`."""
        known = {
            "drag_per_m": None if self.drag is None else vars(self.drag),
            "m_per_s2_without_drag": self.without_drag,
        }
        return {
            "m_per_s2": vars(self.strength),
            "expected": STANDARD,
            "agrees": self.agrees,
            "frame_rate": self.frame_rate,
            "drag_fitted": self.with_drag,
            **{name: value for name, value in known.items() if value is not None},
        }

    @property
    def notes(self) -> tuple[str, ...]:
        """Whether the residuals call for drag, and what a gravity other than 9.81 would mean."""
        return tuple(filter(None, (self._note_on_drag, self._note_on_scale)))

    @property
    def _note_on_drag(self) -> str:
        drag = self.drag
        if drag is None:
            return ""
        figure = f"{rounded(drag.value)} per metre ({rounded(drag.low)} to {rounded(drag.high)})"
        if drag.high < 0:
            return (
                f"The object gains speed along its way (drag {figure}), which no free flight does: "
                "frames with the object in a hand, or numbers of frames that skip?"
            )
        if drag.low <= 0:
            fitted = " Drag was fitted all the same, since it may be too small to see."
            return f"The residuals show no drag: {figure}.{fitted * self.with_drag}"
        if not self.with_drag:
            return f"The residuals show drag, {figure}: fit it, or the vertical leans."
        without = "" if self.without_drag is None else f", g would be {self.without_drag:.2f} m/s²"
        return f"The residuals show drag: {figure}. Without it{without}."

    @property
    def _note_on_scale(self) -> str:
        value, low, high = vars(self.strength).values()
        if self.agrees:
            off = max(high / ON_EARTH[0] - 1, 1 - low / ON_EARTH[1])
            return (
                f"Lengths are right within {100 * off:.1f} %, if the frame rate is; the bar had no "
                "part in this."
            )
        ratio = value / STANDARD
        text = (
            f"Either lengths are {100 * abs(ratio - 1):.1f} % too "
            f"{'long' if ratio > 1 else 'short'} (bar or baseline), or the cameras took "
            f"{rounded(self.frame_rate / np.sqrt(ratio), 4)} frames per second instead of "
            f"{rounded(self.frame_rate, 4)}"
        )
        frames = (value - STANDARD) / self.per_frame if self.per_frame else np.inf
        if abs(frames) <= MOST_FRAMES_LATE:
            when = "later" if frames > 0 else "earlier"
            text += f", or the secondary took each frame {rounded(abs(frames))} frames {when}"
        return f"{text}; gravity alone cannot tell which."
