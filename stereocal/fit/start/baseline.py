"""The value of a baseline that was not measured, or why there is none."""

from stereocal.calibration.board_numbering import check_numbering
from stereocal.calibration.wrong_inputs import MINIMUM_BARS
from stereocal.errors import StereocalError
from stereocal.fit.least_squares.unknowns import RefineSettings
from stereocal.fit.readings.likely_cause import explain_failure
from stereocal.fit.screening.screen import unscreened
from stereocal.fit.start.free_baseline import with_rough_baseline
from stereocal.fit.timing.out_of_step import with_offset_if_out_of_step
from stereocal.rig.pair import Pair


def with_baseline_found(dataset: Pair) -> Pair:
    """The data set with a free baseline set to the refined method's value; with one that was
    measured or is found already, unchanged.

    Raises:
        StereocalError: the points and lengths do not give it.
    """
    if not dataset.baseline_is_to_be_found:
        return dataset
    check_numbering(dataset.recording)
    rough = dataset
    try:
        rough = with_rough_baseline(dataset)
        fit, _ = with_offset_if_out_of_step(rough, RefineSettings(), also_failing=False)
        return dataset.changed(baseline_m=fit.pose.baseline)
    except StereocalError as error:
        if len(dataset.correspondences.bars) < MINIMUM_BARS:
            raise
        # The cause is named, as where the baseline was measured.
        raise StereocalError(explain_failure(rough, unscreened(rough), f"{error} ")) from error
