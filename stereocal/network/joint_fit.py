"""The joint fit of all cameras, in rounds where they are brought into step."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stereocal.errors import StereocalError
from stereocal.network.fit import RigFit, RigSettings
from stereocal.rig.compiled import FloatArray
from stereocal.rig.geometry import Pose
from stereocal.rig.recording import Recording
from stereocal.rig.tracks import interpolate

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
    def of(cls, fit: RigFit, offsets: FloatArray) -> "Start":
        """Where another ended, with the offsets (c,) that its points have been shifted by."""
        late = dict(zip(_offset_names(fit.recording), offsets.tolist(), strict=True))
        return cls(fit.poses, {**fit.unknowns.named(fit.p), **late}, fit.sigma_px)


def joint_fit(
    recording: Recording, start: Start, settings: RigSettings
) -> tuple[RigFit, FloatArray]:
    """The fit, and by how many frames each camera is late."""
    keys, p = _offset_names(recording), dict(start.values)
    offsets = np.array([p.pop(name, 0.0) for name in keys])
    poses, noise_px = start.poses, start.noise_px
    for _ in range(MOST_ROUNDS):
        shifted, velocities = recording, None
        if settings.time_offsets:
            shifted, velocities = _shifted(recording, offsets)
        fit = RigFit(shifted, poses, settings, velocities)
        fit.start_at(p, noise_px)
        if not fit.run():
            raise StereocalError(NO_RIG)
        if not settings.time_offsets:
            break
        values = fit.unknowns.named(fit.p)
        remaining = np.array([values.pop(name, 0.0) for name in keys])
        sigma = np.sqrt(np.diag(fit.unknowns.covariance(fit.information)))
        places = [fit.unknowns.names.index(name) for name in keys if name in fit.unknowns.names]
        offsets, poses, p, noise_px = offsets + remaining, fit.poses, values, fit.sigma_px
        if (np.abs(remaining[1:]) < IN_STEP * sigma[places]).all():
            break
    return fit, offsets


def _offset_names(recording: Recording) -> list[str]:
    """The names of the unknown time offsets."""
    return [f"{name} time offset" for name in recording.cameras]


def _shifted(recording: Recording, offsets: FloatArray) -> tuple[Recording, FloatArray]:
    """The points at the instants of the reference's frames, without those of late cameras that have
    no neighbours there; and their velocities (n, 2), in pixels per frame."""
    offset = offsets[recording.camera]
    track = recording.camera * len(recording.object.names) + recording.target
    tracks = interpolate(track, recording.frame, recording.points, offset)
    moved, known = offset != 0.0, tracks.known.copy()
    for number, camera in enumerate(recording.cameras.values()):
        of_camera = recording.camera == number
        known[of_camera] &= tracks.inside(camera.image_size)[of_camera]
    points = np.where((moved & known)[:, None], tracks.positions, recording.points)
    usable = ~moved | known
    shifted = replace(recording, points=points).where(usable)
    return shifted, np.nan_to_num(tracks.velocities[usable])
