"""A and B agree between the cameras; frames that are wrong or doubtful are said to be."""

import numpy as np
import numpy.typing as npt
import pytest

from stereocal.detection.target import Sighting, Spot
from stereocal.frames.epipolar_labels import FrameLabels, decide_labels
from tests import known_rig as rig

FRAMES = 20
CAMERAS = (rig.PRIMARY, rig.SECONDARY)


def sighting(both: npt.NDArray[np.float64]) -> Sighting:
    a, b = (Spot(u, v, 0.01, 40.0) for u, v in both.tolist())
    return Sighting((a, b), "")


def bars(frames: int = FRAMES, noise_px: float = 0.03) -> list[npt.NDArray[np.float64]]:
    """Per camera (f, 2, 2): frame, target, u and v."""
    rng = np.random.default_rng(3)
    images = rig.images(rig.bar_ends(frames))
    return [(image + noise_px * rng.normal(size=image.shape)).reshape(-1, 2, 2) for image in images]


def labelled(
    primary: npt.NDArray[np.float64], secondary: npt.NDArray[np.float64], seed: int = 0
) -> list[tuple[bool, FrameLabels]]:
    """For each frame, whether the secondary's targets are exchanged, and the report."""
    centres = dict(enumerate(np.stack([primary, secondary], axis=1)))
    return [*decide_labels(centres, CAMERAS, seed).values()]


@pytest.mark.parametrize(("wrong", "seed"), [(0.0, 0), (0.2, 1), (0.5, 0), (0.5, 1), (1.0, 0)])
def test_any_share_of_exchanged_labels_is_put_right(wrong: float, seed: int) -> None:
    primary, secondary = bars()
    exchanged = np.random.default_rng(seed).permutation(FRAMES) < wrong * FRAMES
    given = np.where(exchanged[:, None, None], secondary[:, ::-1], secondary)
    labelling = labelled(primary, given, seed)
    for (exchange, report), was in zip(labelling, exchanged, strict=True):
        assert exchange == was
        assert report.state == ("swapped" if exchange else "agreed") and report.is_sure
        assert report.residual_px < 0.1 < report.swapped_px
        assert bool(report.sentence) == exchange


def test_frames_off_the_others_stand_out_and_stay() -> None:
    primary, secondary = bars()
    off = secondary.copy()
    off[3, 0, 1] += 25.0
    off[7] += [[30.0, 40.0], [-20.0, 35.0]]
    reports = [report for _, report in labelled(primary, off)]
    assert [at for at, report in enumerate(reports) if report.state == "outlying"] == [3, 7]
    assert [at for at, report in enumerate(reports) if not report.is_sure] == [3, 7]
    assert reports[3].residual_px > 2.0


def test_a_bar_along_the_epipolar_lines_is_told_by_its_length() -> None:
    middle = np.array([0.2, 0.1, 7.0])
    along = np.linalg.inv(rig.RIG.R) @ rig.RIG.T
    along = 0.5 * rig.BAR_M * along / np.linalg.norm(along)
    ends = rig.bar_ends(FRAMES).reshape(-1, 2, 3)
    ends[4] = [middle - along, middle + along]
    # On a bar along the baseline, wrong labels give crossing rays all the same, but other depths.
    primary, secondary = (image.reshape(-1, 2, 2) for image in rig.images(ends.reshape(-1, 3)))
    given = secondary.copy()
    given[4] = given[4, ::-1]
    labelling = labelled(primary, given)
    report = labelling[4][1]
    assert max(report.residual_px, report.swapped_px) < 0.3
    assert report.state == "swapped"
    assert [exchange for exchange, _ in labelling] == [at == 4 for at in range(FRAMES)]
