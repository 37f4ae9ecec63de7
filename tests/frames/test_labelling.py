"""What the other frames tell: which target is A, what is wrong, which boards are the targets, and
which photograph has no partner."""

import itertools
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import pytest

from stereocal.detection.target import BAR, Sighting, Spot
from stereocal.frames.choosing import choose_boards
from stereocal.frames.epipolar_labels import FrameLabels, decide_labels
from stereocal.frames.frame import Frame
from stereocal.frames.labelling import label_frames
from stereocal.frames.pairing import PhotographPair
from stereocal.frames.slips import find_slips
from stereocal.system.array_types import FloatArray
from tests.further import further
from tests.rigs import known_rig as rig

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


def in_order(
    lost: tuple[Sequence[int], Sequence[int]],
    noise_px: float = 0.3,
    unseen: tuple[int, ...] = (),
    frames: int = FRAMES,
) -> list[Frame]:
    """The frames of photographs paired in order.

    Args:
        lost: of both cameras the numbers of the photographs that were not taken.
        unseen: photographs of both cameras without targets.
    """
    names = [[f"{camera}_{i}" for i in range(frames)] for camera in ("IMG", "DSC")]
    found = {
        name: sighting(one)
        for own, images in zip(names, bars(frames, noise_px), strict=True)
        for name, one in zip(own, images, strict=True)
    }
    left = [
        [name for i, name in enumerate(own) if i not in gone]
        for own, gone in zip(names, lost, strict=True)
    ]
    pairs = [PhotographPair(i, *both) for i, both in enumerate(zip(*left, strict=False), start=1)]
    labelled_frames = label_frames(pairs, found, CAMERAS, BAR)
    none = ((None, None), (None, None))
    return [
        Frame(f.frame, f.files, none, "refused") if f.frame in unseen else f
        for f in labelled_frames
    ]


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ((), (4,)),
        ((0,), ()),
        ((), (5, 12)),
        ((4,), (15,)),
        *further(((15,), ()), ((), (0,)), ((4,), ()), ((), (15,)), ((0, 1), ()), ((), (5, 12, 16))),
    ],
)
def test_the_photographs_without_a_partner_are_named(
    first: tuple[int, ...], second: tuple[int, ...]
) -> None:
    """Of 146 recordings of 24 drawn photographs with one to three missing, 94 were named wholly, 26
    but for those of the end, and none wrongly: what is missing there, or within five photographs in
    both cameras, cannot be told. Of 32 in which the bar moves on by 15 cm only, 11 and 2, none
    wrongly. A recording took 0.3 s, at most 2."""
    slips = find_slips(in_order((first, second), frames=24), CAMERAS)
    assert slips is not None
    assert slips.names == (tuple(f"IMG_{i}" for i in second), tuple(f"DSC_{i}" for i in first))


def test_photographs_without_a_partner_are_one_sentence() -> None:
    slips = find_slips(in_order(((17,), (4, 10)), frames=30), CAMERAS)
    assert str(slips).startswith(
        "The secondary camera has no photograph for IMG_4 and IMG_10; the primary camera has no "
        "photograph for DSC_17. Without them, and with the others paired in order, the targets of 2"
    )


def test_photographs_without_targets_do_no_harm() -> None:
    slips = find_slips(in_order(((), (8,)), unseen=(3, 12, 15)), CAMERAS)
    assert slips is not None and slips.all == ("IMG_8",)


def test_a_bar_that_stands_still_names_no_photograph() -> None:
    frames = in_order(((), (3, 9)), noise_px=0.05)
    held = [Frame(f.frame, f.files, frames[0].centres, "doubtful") for f in frames]
    assert find_slips(held, CAMERAS) is None
    assert find_slips(in_order(((), (17,))), CAMERAS) is None  # two frames only would tell


def test_sound_pairs_and_single_wrong_frames_are_no_slip() -> None:
    frames = in_order(((), ()))
    assert find_slips(frames, CAMERAS) is None
    rng = np.random.default_rng(1)
    for at in rng.permutation(FRAMES)[:5]:
        a, b = frames[at].centres[0]
        assert a is not None and b is not None
        moved = frames[at].moved(0, 0, type(a)(a.u + 90.0, a.v + 70.0))
        frames[at] = Frame(moved.frame, moved.files, moved.centres, "doubtful")
    assert find_slips(frames, CAMERAS) is None


BOARD_NOISE_PX = 0.05


def among(boards: FloatArray) -> Sighting:
    """A photograph with boards (m, 2) that all look like targets, the first two the least."""
    pairs = list(itertools.combinations(boards, 2))[::-1]
    alternatives = tuple(sighting(np.array(pair)) for pair in pairs)
    if len(boards) == 2:
        return alternatives[0]
    return Sighting((None, None), "Too many.", alternatives=alternatives)


def seen(points: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Pixels (m, 2) of points in both cameras, with noise."""
    first, second = rig.images(points)
    noise = BOARD_NOISE_PX * rng.normal(size=(2, *first.shape))
    return first + noise[0], second + noise[1]


def sure_frames(frames: int = 20, seed: int = 7) -> tuple[FloatArray, FloatArray]:
    """Places (f, 2, 3) and pixels (f, 2, 2, 2) of frames that are sure: target, camera, (u, v)."""
    ends = rig.bar_ends(frames, seed)
    pixels = np.stack(seen(ends, np.random.default_rng([seed, 2])), axis=1)
    return ends.reshape(-1, 2, 3), pixels.reshape(-1, 2, 2, 2)


def inside(rng: np.random.Generator) -> FloatArray:
    return rng.uniform([-1.3, -1.1, 6.0], [1.3, 1.0, 10.5])


def third_board(kind: str, ends: FloatArray, rng: np.random.Generator) -> FloatArray:
    """A third board (3,) for a frame of the bar (2, 3)."""
    place = inside(rng)
    if kind == "on the line":  # of target B, in both cameras
        normal = np.cross(rig.RIG.inverse().T, ends[1])
        normal /= np.linalg.norm(normal)
        return np.asarray(place - (place @ normal) * normal)
    if kind == "as far as the bar":
        return np.asarray(ends[0] + rig.BAR_M * (v := rng.normal(size=3)) / np.linalg.norm(v))
    return place


def is_right(one: Sighting, pixels: FloatArray) -> bool:
    """Whether the chosen boards are the first two of those seen (m, 2)."""
    return all(spot and [*spot.centre] in pixels[:2].tolist() for spot in one.spots)


def right_choices(
    sure: FloatArray, boards: list[tuple[FloatArray, FloatArray]]
) -> list[tuple[int, bool]]:
    """The frames that the sure ones decide, and whether the first two boards were chosen."""
    given = {k: (among(first), among(second)) for k, (first, second) in enumerate(boards)}
    chosen = choose_boards(sure, given, CAMERAS)
    assert all(one.sentence for one in chosen.values())
    return [
        (k, is_right(one.primary, boards[k][0]) and is_right(one.secondary, boards[k][1]))
        for k, one in chosen.items()
        if not one.primary.alternatives
    ]


@pytest.mark.parametrize(
    ("kind", "least", "most"),
    [("elsewhere", 40, 50), ("on the line", 32, 50), ("as far as the bar", 0, 0), ("hidden", 0, 0)],
)
def test_what_the_others_decide_is_right(kind: str, least: int, most: int) -> None:
    """50 frames with a third board that moves and both cameras see, each after 20 sure ones.

    Measured: 93 and 77 % decided; in the others nothing tells which two are the bar's: the third is
    as far from A as B is, or the secondary hides B. Over 12 seeds with 8 or 20 sure frames, 3,840
    frames in all, none was decided wrongly.
    """
    _, sure = sure_frames()
    rng = np.random.default_rng(11)
    boards = []
    for ends in rig.bar_ends(50, seed=8).reshape(-1, 2, 3):
        first, second = seen(np.vstack([ends, third_board(kind, ends, rng)]), rng)
        boards.append((first, second[[0, 2]] if kind == "hidden" else second))
    decided = right_choices(sure, boards)
    assert all(right for _, right in decided)
    assert least <= len(decided) <= most
