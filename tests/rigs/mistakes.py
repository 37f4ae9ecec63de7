"""The ordinary mistakes of a first hour: exchanged frames, wrong points, wrong inputs."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from stereocal.errors import StereocalError
from stereocal.refined.disagreement import what_disagrees
from stereocal.refined.results import Calibration
from stereocal.refined.unknowns import RefineSettings
from stereocal.rig.camera import Camera
from stereocal.rig.dataset import Dataset
from stereocal.simulation.simulate import Scene, lens_off_by
from stereocal.workflow import calibrate
from tests.rigs.refined_rigs import Misjudged, random_scene, stated

KNOWN = Misjudged()
SEED = 71
SLIPS_PX = (20.0, 100.0)
BAD_POINTS = 0.3


def rig(number: int) -> tuple[Scene, Dataset, np.random.Generator]:
    """Rig number so and so: its truth, its data set with stated uncertainties, more randomness."""
    rng = np.random.default_rng([number, SEED])
    scene = random_scene(rng)
    data = stated(scene, rng, KNOWN)
    sigmas = {"baseline_sigma_m": KNOWN.baseline_m, "target_distance_sigma_m": KNOWN.bar_m}
    return scene, replace(data, **sigmas), rng  # type: ignore[arg-type]


def with_frames_exchanged(
    data: Dataset, rng: np.random.Generator, count: int
) -> tuple[Dataset, tuple[int, ...]]:
    """A and B exchanged in one camera, drawn by chance, in so many frames; and these frames."""
    rows = data.correspondences
    images = rows.primary.copy(), rows.secondary.copy()
    bad = rng.choice(len(rows.bars), count, replace=False)
    for bar in bad:
        a, b = rows.bars[bar]
        image = images[int(rng.integers(2))]
        image[[a, b]] = image[[b, a]]
    changed = replace(rows, primary=images[0], secondary=images[1])
    frames = sorted(int(frame) for frame in rows.frame[rows.bars[bad, 0]])
    return replace(data, correspondences=changed), tuple(frames)


def with_points_off(
    data: Dataset, rng: np.random.Generator, share: float = BAD_POINTS
) -> tuple[Dataset, tuple[int, ...]]:
    """A share of the points off by 20 to 100 px in one image; and the frames that have one."""
    rows = data.correspondences
    images = rows.primary.copy(), rows.secondary.copy()
    sizes = data.primary.image_size, data.secondary.image_size
    bad = rng.choice(len(rows), round(share * len(rows)), replace=False)
    for row in bad:
        which = int(rng.integers(2))
        largest = np.array(sizes[which]) - 1.0
        while True:
            angle = rng.uniform(0.0, 2 * np.pi)
            slip = rng.uniform(*SLIPS_PX) * np.array([np.cos(angle), np.sin(angle)])
            moved = images[which][row] + slip
            if ((moved >= 0) & (moved <= largest)).all():
                images[which][row] = moved
                break
    changed = replace(rows, primary=images[0], secondary=images[1])
    return replace(data, correspondences=changed), tuple(sorted({int(f) for f in rows.frame[bad]}))


def _with_lens(data: Dataset, which: str, change: Callable[[Camera], Camera]) -> Dataset:
    camera = change(getattr(data, which))
    return replace(data, primary=camera) if which == "primary" else replace(data, secondary=camera)


def flipped(camera: Camera) -> Camera:
    """The lens with all distortion of the other sign."""
    return replace(camera, distortion=-camera.distortion)


def scaled(camera: Camera, factor: float) -> Camera:
    """The lens as it would be for an image so many times as large."""
    K = camera.K.copy()
    K[:2] *= factor
    return replace(camera, K=K)


@dataclass(frozen=True)
class Mistake:
    """A wrong input: what it changes, and which words name it."""

    change: Callable[[Dataset], Dataset]
    names: tuple[str, ...]
    """It is named when one of these stands in a message, or is an accused input or its rival."""
    least_of_10: int
    """A tenth of what 40 rigs gave, less what chance takes."""


WRONG: dict[str, Mistake] = {
    "baseline 3 %": Mistake(lambda d: replace(d, baseline_m=1.03 * d.baseline_m), ("baseline",), 9),
    "bar 2 %": Mistake(
        lambda d: replace(d, target_distance_m=1.02 * d.target_distance_m), ("distance",), 9
    ),
    "focal length 2 %": Mistake(
        lambda d: _with_lens(d, "primary", lambda c: lens_off_by(c, 0.02, (0.0, 0.0))),
        ("primary focal",),
        9,
    ),
    "distortion sign, primary": Mistake(
        lambda d: _with_lens(d, "primary", flipped), ("primary camera's distortion",), 9
    ),
    "distortion sign, secondary": Mistake(
        lambda d: _with_lens(d, "secondary", flipped), ("secondary camera's distortion",), 7
    ),
    "K of half the image": Mistake(
        lambda d: _with_lens(d, "primary", lambda c: scaled(c, 0.5)), ("primary camera's lens",), 9
    ),
    "K of twice the image": Mistake(
        lambda d: _with_lens(d, "secondary", lambda c: scaled(c, 2.0)),
        ("secondary camera's matrix K",),
        9,
    ),
}


@dataclass(frozen=True)
class Said:
    """What is said of one rig with a wrong input."""

    named: bool
    refused: bool
    accused: tuple[str, ...]
    """Keys of the inputs that *What disagrees* accuses, without rivals."""


def said_of(name: str, number: int) -> Said:
    """A rig with one wrong input of `WRONG`, or none ("sound")."""
    _, data, _ = rig(number)
    mistake = WRONG.get(name)
    try:
        wrong = mistake.change(data) if mistake else data
        calibration = calibrate(wrong, refined=_as_stated())
    except StereocalError as error:
        words = mistake.names if mistake else ()
        return Said(any(word in str(error) for word in words), True, ())
    return _said(calibration, mistake)


def _as_stated() -> RefineSettings:
    settings = KNOWN.settings()
    return replace(settings, baseline_sigma_m=None, distance_sigma_m=None)


def _said(calibration: Calibration, mistake: Mistake | None) -> Said:
    accused = (
        [item for item in what_disagrees(calibration.refined) if item.accused]
        if calibration.refined
        else []
    )
    text = " ".join(calibration.warnings)
    named = mistake is not None and (
        any(word in text for word in mistake.names)
        or any(key in mistake.names for item in accused for key in (item.key, *item.rivals))
    )
    return Said(named, False, tuple(item.key for item in accused))
