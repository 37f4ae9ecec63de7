"""Parameters with the new images that they are checked with: of two cameras, or of a rig."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from stereocal.field.checking.findings import Recheck
from stereocal.field.checking.fits import Smallest
from stereocal.field.checking.new_images import NewImages
from stereocal.field.checking.prior import prior_of
from stereocal.field.checking.recheck import recheck
from stereocal.field.checking.repair import Residuals, residuals_of
from stereocal.field.checking.rig_check import RigCheck, check_rig
from stereocal.fit.rig_file import Parameters, RigFile
from stereocal.fit.start.pairs import pair_name
from stereocal.matching.point_noise import PointNoise, noise_of_calibration
from stereocal.rig.parameters import RigParameters
from stereocal.rig.recording import Recording


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
        """Of the table, else of the calibration; None if neither says it."""
        stated = self.images.stated_px
        return PointNoise(stated, "columns") if stated else noise_of_calibration(self.parameters)

    def stating(self, sigma_px: float | None) -> "PairToCheck":
        """With the noise of matched points."""
        return replace(self, images=self.images.stating(sigma_px))

    def check(self, smallest: Smallest) -> tuple[Recheck | RigCheck, Mapping[str, Residuals]]:
        """The answer, and the errors by pair; the only one has no name."""
        found = recheck(prior_of(self.parameters), self.images, smallest)
        return found, {"": residuals_of(found)}


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

    def check(self, smallest: Smallest) -> tuple[Recheck | RigCheck, Mapping[str, Residuals]]:
        """The answer, and the errors by pair."""
        found = check_rig(self.parameters, self.recording, smallest)
        return found, {pair_name(pair): residuals_of(own) for pair, own in found.pairs.items()}


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
