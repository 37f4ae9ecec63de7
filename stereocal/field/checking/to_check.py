"""Parameters with the new images that they are checked with, of two cameras or of a rig; and the
answer."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from stereocal.field.checking import check_words
from stereocal.field.checking.behind_windows import WindowCheck, check_behind_windows
from stereocal.field.checking.findings import Verdict
from stereocal.field.checking.fits import Smallest
from stereocal.field.checking.known_behind_windows import known_of_pair, known_of_rig
from stereocal.field.checking.new_images import NewImages
from stereocal.field.checking.prior import prior_of
from stereocal.field.checking.recheck import recheck
from stereocal.field.checking.repair import REPAIRED, Residuals, repaired_parameters, residuals_of
from stereocal.field.checking.rig_check import check_rig
from stereocal.fit.rig_file import Parameters, RigFile
from stereocal.matching.point_noise import PointNoise, noise_of_calibration
from stereocal.rig.camera import CAMERAS
from stereocal.rig.parameters import RigParameters
from stereocal.rig.recording import CameraPair, Recording


@dataclass(frozen=True, eq=False)
class CheckAnswer:
    """What new images say about parameters: what the command writes and the page draws."""

    verdict: Verdict
    sentence: str
    notes: Sequence[str]
    content: Mapping[str, Any]
    """The entries of `check.json`, except the names of the files."""
    residuals: Mapping[CameraPair, Residuals]
    repaired: RigParameters | None
    """None if there is nothing to repair, or of a rig."""


@dataclass(frozen=True, eq=False)
class PairToCheck:
    """Two cameras with a parameter set, and new bars or matched points."""

    parameters: RigParameters
    images: NewImages

    @property
    def of_points_alone(self) -> bool:
        """Whether the noise of the points matters: bars tell their own."""
        return not self.images.bars

    @property
    def usual_noise(self) -> PointNoise | None:
        """The noise that the table states, else that of the calibration; None if neither does."""
        stated = self.images.stated_px
        return PointNoise(stated, "columns") if stated else noise_of_calibration(self.parameters)

    def stating(self, sigma_px: float | None) -> "PairToCheck":
        """With the noise of matched points."""
        return replace(self, images=self.images.stating(sigma_px))

    def check(
        self, smallest: Smallest, source: str = "parameters", sha256: str | None = None
    ) -> CheckAnswer:
        """The answer.

        Args:
            source: what the parameters are called in messages.
            sha256: of their file, which the repaired ones name; None if they are of no file.

        Raises:
            StereocalError: the parameters have no covariance, or nothing fits the points.
        """
        if self.parameters.has_windows:
            recording = self.images.dataset.recording
            known = known_of_pair(self.parameters, source, recording.cameras)
            return _of_windows(check_behind_windows(known, recording, smallest, self.images.own))
        checked = recheck(prior_of(self.parameters, source), self.images, smallest)
        offered = checked.offers_repair
        return CheckAnswer(
            checked.verdict,
            check_words.sentence(checked),
            check_words.notes(checked),
            check_words.to_json(checked, REPAIRED if offered else None),
            {self.parameters.camera_names or CAMERAS: residuals_of(checked)},
            repaired_parameters(checked, sha256) if offered else None,
        )


@dataclass(frozen=True, eq=False)
class RigToCheck:
    """A rig, and a recording of its cameras."""

    parameters: RigFile
    recording: Recording
    of_points_alone = False
    usual_noise = None

    def stating(self, _sigma_px: float | None) -> "RigToCheck":
        """Itself: bars tell their noise."""
        return self

    def check(
        self, smallest: Smallest, _source: str = "", _sha256: str | None = None
    ) -> CheckAnswer:
        """The answer; a rig is calibrated again, not repaired.

        Raises:
            StereocalError: no pair of its cameras can be checked.
        """
        rig = self.parameters
        if any(camera.window is not None for camera in rig.cameras.values()):
            own = rig.about.inputs.get("sha256") == self.recording.sha256
            known = known_of_rig(rig)
            return _of_windows(check_behind_windows(known, self.recording, smallest, own))
        checked = check_rig(self.parameters, self.recording, smallest)
        residuals = {pair: residuals_of(check) for pair, check in checked.pairs.items()}
        return CheckAnswer(
            checked.verdict, checked.sentence, checked.notes, checked.to_json(), residuals, None
        )


def _of_windows(checked: WindowCheck) -> CheckAnswer:
    """The answer of cameras behind windows, which are calibrated again, not repaired."""
    return CheckAnswer(
        checked.verdict, checked.sentence, checked.notes, checked.to_json(), checked.residuals, None
    )


ToCheck = PairToCheck | RigToCheck


def with_new(
    parameters: Parameters,
    images: Callable[[RigParameters], NewImages],
    recording: Callable[[RigFile], Recording],
) -> ToCheck:
    """The parameters with new images: the one place that asks whether they are of two cameras.

    Args:
        images, recording: read the new images, of two cameras and of a rig.
    """
    if isinstance(parameters, RigFile):
        return RigToCheck(parameters, recording(parameters))
    return PairToCheck(parameters, images(parameters))
