"""The joint adjustment of a rig: its unknowns, their priors, and the robust fit of N views."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from stereocal.refined.observations import Observations
from stereocal.refined.robust import RobustFit
from stereocal.refined.small_steps import pose_at
from stereocal.refined.unknowns import (
    DEFAULT_BASELINE,
    DEFAULT_DISTANCE,
    LensPrior,
    RefineSettings,
    Unknowns,
    lens_prior,
    unknowns_of,
)
from stereocal.rig.geometry import Pose
from stereocal.rig.recording import Recording
from stereocal.system.array_types import FloatArray


@dataclass(frozen=True)
class RigSettings:
    """What is stated of a rig's cameras and lengths, where the recording does not say it."""

    lenses: Mapping[str, LensPrior] = field(default_factory=dict)
    """By camera. Others: the camera's own uncertainty if it has one, else 1 % and 10 px."""
    baseline_sigma_m: float | None = None
    """None: the recording's, else 1 % of each."""
    object_sigma: float | None = None
    """Standard deviation of the object's lengths, as a fraction, common to all. None: the
    recording's, else 0.1 %."""
    time_offsets: bool | None = None
    """Whether each camera may be out of step by some frames; None: where that is significant."""
    time_drifts: bool = False
    """Whether these offsets drift."""


def unknowns_of_rig(
    recording: Recording, poses: Sequence[Pose], settings: RigSettings, bars: bool = True
) -> Unknowns:
    """The unknowns of a recording; the first camera is the reference and has no pose.

    Args:
        poses: `camera_from_reference` of each camera.
        bars: whether there are known lengths; if not, their factor is held fixed.
    """
    lenses = {
        name: lens_prior(camera, settings.lenses.get(name))
        for name, camera in recording.cameras.items()
    }
    late = bool(settings.time_offsets), bool(settings.time_offsets and settings.time_drifts)
    sigma, _ = object_sigma(recording, settings)
    return unknowns_of(recording.cameras, poses, lenses, sigma * bars, late)


def object_sigma(recording: Recording, settings: RigSettings) -> tuple[float, bool]:
    """Standard deviation of the object's lengths, a fraction, and whether it was stated."""
    stated = recording.object.sigma_m
    if settings.object_sigma is not None:
        return settings.object_sigma, True
    if stated is not None:
        return stated / recording.object.longest_m, True
    return DEFAULT_DISTANCE, False


def baselines_of(recording: Recording, settings: RigSettings) -> FloatArray:
    """The measured baselines, as `adjustment.add_baselines` takes them."""
    numbers = {name: number for number, name in enumerate(recording.cameras)}
    stated = settings.baseline_sigma_m or recording.baseline_sigma_m
    rows = [
        (numbers[first], numbers[second], length, stated or DEFAULT_BASELINE * length)
        for (first, second), length in recording.baselines_m.items()
        if not np.isinf(stated or 0.0)
    ]
    return np.array(rows, dtype=np.float64).reshape(-1, 4)


class RigFit(RobustFit):
    """A fit from first poses."""

    def __init__(
        self,
        recording: Recording,
        poses: Sequence[Pose],
        settings: RigSettings,
        held: RefineSettings | None = None,
    ) -> None:
        """From first poses.

        Args:
            held: with the noise that is not to be estimated.
        """
        self.recording, self.rig_settings = recording, settings
        seen = Observations.of(recording, bool(settings.time_offsets))
        unknowns = unknowns_of_rig(recording, poses, settings, seen.has_lengths)
        R, baselines = np.array([pose.R for pose in poses]), baselines_of(recording, settings)
        super().__init__(seen, unknowns, held or RefineSettings(), R, baselines)

    @property
    def poses(self) -> list[Pose]:
        """`camera_from_reference` of each camera."""
        return [pose_at(self.at, number) for number in range(len(self.R))]

    @property
    def is_determined(self) -> bool:
        """Whether all that was solved for is a number with an error."""
        return bool(np.isfinite(self.q).all()) and self.at_end.determined(self.H)
