"""Small photographs of the bar with known centres, for tests of the way from files to tables."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import islice

import numpy as np

from stereocal.detection.target import BAR
from stereocal.formats.camera_file import write_camera
from stereocal.frames.frame import Frame
from stereocal.frames.search import detect_frames
from stereocal.projects.inputs import Slot
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.rig.camera import Camera
from stereocal.rig.rig import Rig
from stereocal.simulation.simulate import field_rig
from tests.files import description, encoded
from tests.photographs.lens import AtOnce
from tools.photographs.bars import BarSettings, PhotographPair, photograph_bars, place_visible_bars
from tools.photographs.rendering import PhotographSettings

SHRINK = 4
MOST = 16
BOARD_M, BAR_M, DEPTHS_M = 0.3, 0.9, (6.0, 9.0)


@dataclass(frozen=True)
class BarSet:
    """Frames of the bar and the rig that took them."""

    rig: Rig
    pairs: Sequence[PhotographPair]

    def files(self, suffix: str = ".png") -> dict[str, bytes]:
        """primary/left1.png, secondary/right1.png, and so on."""
        found = {}
        for pair in self.pairs:
            for name, image in (
                (f"primary/left{pair.frame}", pair.primary),
                (f"secondary/right{pair.frame}", pair.secondary),
            ):
                found[name + suffix] = encoded(image, suffix)
        return found

    @property
    def cameras(self) -> dict[Slot, tuple[str, bytes]]:
        """The camera files, as a project is given them."""
        return {
            "primary": ("primary.json", write_camera(self.rig.primary)),
            "secondary": ("secondary.json", write_camera(self.rig.secondary)),
        }

    @property
    def described(self) -> dict[str, bytes]:
        """`dataset.json` and the camera files, as a folder has them."""
        about = description("bars", self.rig.pose.baseline, BAR_M)
        return {"dataset.json": about, **dict(self.cameras.values())}

    def frames_of(self, store: ProjectPhotographs) -> list[Frame]:
        """What is found in the photographs of a project that has them."""
        lenses = {"primary": self.rig.primary, "secondary": self.rig.secondary}
        about = store.pairing(), store.photographs, lenses, BAR
        return detect_frames(*about, AtOnce(), lambda _: None, lambda *_: None).frames


def small(camera: Camera) -> Camera:
    """A camera with the same lens and fewer, larger pixels."""
    K = camera.K / SHRINK
    K[2, 2] = 1.0
    width, height = camera.image_size
    return Camera(K, camera.distortion, (width // SHRINK, height // SHRINK))


@cache
def _frames() -> tuple[Rig, Iterator[PhotographPair], list[PhotographPair]]:
    """The rig, frames that are not rendered yet, and those that are."""
    rng = np.random.default_rng(3)
    field = field_rig(baseline_m=2.0)
    rig = Rig(small(field.primary), small(field.secondary), field.pose)
    scene = place_visible_bars(rig, rng, MOST, BAR_M, BOARD_M, depths_m=DEPTHS_M, margin_px=40.0)
    bar = BarSettings(board_m=BOARD_M)
    return rig, photograph_bars(scene, (110.0, 110.0), bar, PhotographSettings(), rng), []


def bar_set(frames: int) -> BarSet:
    """The first frames, `MOST` or fewer, of 584 x 432 px before a plain background."""
    rig, further, rendered = _frames()
    rendered.extend(islice(further, max(0, frames - len(rendered))))
    return BarSet(rig, tuple(rendered[:frames]))
