"""The joint fit of all cameras, in rounds where they are brought into step."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import compress

import numpy as np

from stereocal.errors import StereocalError
from stereocal.fit.least_squares.robust import RobustFit
from stereocal.fit.least_squares.unknowns import RefineSettings
from stereocal.rig.geometry import Pose
from stereocal.rig.recording import Recording
from stereocal.rig.tracks import TimeOffset
from stereocal.system.array_types import FloatArray

MOST_ROUNDS = 8
IN_STEP = 0.05
"""A remaining time offset below this fraction of its standard error is left to the fit."""
NO_RIG = (
    "No rig of these cameras fits the points: check that points and camera files are not exchanged."
)


@dataclass(frozen=True)
class Start:
    """Where a joint fit begins."""

    poses: Sequence[Pose]
    values: Mapping[str, float]
    """Of free parameters by name."""
    noise_px: float

    @classmethod
    def of(cls, fit: RobustFit, offsets: Sequence[TimeOffset]) -> "Start":
        """Where another ended, with the offsets that its points have been shifted by."""
        late = {
            f"{name} time {what}": value
            for name, offset in zip(fit.recording.labels, offsets, strict=True)
            for what, value in (("offset", offset.frames), ("drift", offset.drift))
        }
        return cls(fit.poses, {**fit.unknowns.named(fit.p), **late}, fit.sigma_px)


def joint_fit(
    recording: Recording, start: Start, settings: RefineSettings
) -> tuple[RobustFit, tuple[TimeOffset, ...]]:
    """The fit, and by how many frames each camera is late."""
    keys = [f"{name} time {what}" for what in ("offset", "drift") for name in recording.labels]
    p, reference = dict(start.values), float(np.round(recording.frame.mean()))
    late = np.array([p.pop(name, 0.0) for name in keys])
    poses, noise_px = start.poses, start.noise_px
    for _ in range(MOST_ROUNDS):
        shifted = recording
        if settings.time_offset:
            offsets = dict(zip(recording.cameras, _offsets(late, reference), strict=True))
            shifted = recording.shifted(offsets)
            shifted = shifted.where(shifted.usable)
        fit = RobustFit.of(shifted, poses, settings)
        fit.start_at(p, noise_px)
        if not fit.run():
            raise StereocalError(NO_RIG)
        if not settings.time_offset:
            break
        values = fit.unknowns.named(fit.p)
        free = [key in values for key in keys]
        remaining = np.array([values.pop(name, 0.0) for name in keys])
        sigma = np.sqrt(np.diag(fit.at_end.covariance(fit.H)))
        places = [fit.unknowns.names.index(name) for name in compress(keys, free)]
        late, poses, p, noise_px = late + remaining, fit.poses, values, fit.sigma_px
        if (np.abs(remaining[free]) < IN_STEP * sigma[places]).all():
            break
    return fit, _offsets(late, reference)


def _offsets(late: FloatArray, reference: float) -> tuple[TimeOffset, ...]:
    """The time offsets of all cameras from their frames and drifts (2 c,)."""
    frames, drifts = late.reshape(2, -1).tolist()
    return tuple(
        TimeOffset(late, drift, reference) for late, drift in zip(frames, drifts, strict=True)
    )
