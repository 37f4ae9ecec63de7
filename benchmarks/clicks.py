"""Clicked points: the error of a mean length over its stated one, the drift of proposed places, and
the CPU time from a click to its answer.

    python -m benchmarks.clicks
"""

import json
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from stereocal.formats.dataset_files import read_dataset
from stereocal.frames.video.footage import Footage, of_videos
from stereocal.matching.clicks import Click, ClickMeasure, Clicks, MeasuredClicks, Place
from stereocal.matching.following import follow, nearest_clicks
from stereocal.projects.clicks import Act, ProjectClicks
from stereocal.projects.project import Project
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.geometry import Pose
from stereocal.rig.rig import Rig
from stereocal.workflow.answer import PairAnswer
from stereocal.workflow.pair_run import PairRun
from tools.photographs.flight_sample import LENGTH_M

SAMPLES = Path(__file__).parents[1] / "sample_data"
FLIGHTS, FRAMES = 150, 5
BOTH = ("head", "tail")


@dataclass(frozen=True)
class Flights:
    """A true rig, and things that fly before it."""

    rig: Rig

    @classmethod
    def before_the_field(cls) -> "Flights":
        truth = json.loads((SAMPLES / "field" / "truth.json").read_text())
        first, second = (Camera.from_json(truth["cameras"][name], name) for name in CAMERAS)
        return cls(Rig(first, second, Pose(truth["R"], truth["T"])))

    def clicks(self, seed: int, frames: int, noise_px: float) -> Clicks:
        """Head and tail, clicked with this noise."""
        rng = np.random.default_rng(seed)
        start = rng.uniform([-0.5, -0.4, 10.0], [0.5, 0.4, 20.0])
        step, along = rng.normal(size=3) * 0.05, rng.normal(size=3)
        along *= LENGTH_M / np.linalg.norm(along)
        found = []
        for frame in range(1, frames + 1):
            for track, end in zip(BOTH, (0.0, 1.0), strict=True):
                point = (start + step * (frame % 20) + along * end)[None]
                seen = (
                    self.rig.primary.project(point),
                    self.rig.secondary.project(self.rig.pose.apply(point)),
                )
                for camera, pixels in zip(CAMERAS, seen, strict=True):
                    u, v = pixels[0] + noise_px * rng.normal(size=2)
                    found.append(Click(frame, camera, track, float(u), float(v)))
        return Clicks.of(found)


def lengths(flights: Flights, how: ClickMeasure, noise_px: float) -> None:
    """Print the rms of the errors of mean lengths over the stated errors."""
    stated = replace(how.stated, sigma_px=noise_px)
    how = replace(how, stated=stated)
    relative = []
    for seed in range(FLIGHTS):
        clicks = flights.clicks(seed, FRAMES, noise_px)
        found = how.measured(clicks, how.settled(clicks))
        length = found.length(*found.common(*BOTH))
        if length is not None:
            relative.append((length.metres - LENGTH_M) / length.sigma_m)
    rms, within = np.sqrt(np.mean(np.square(relative))), np.mean(np.abs(relative) < 2)
    print(f"{noise_px} px, {len(relative)} flights: rms {rms:.2f}, {100 * within:.0f} % within two")


def drift(footage: Footage) -> None:
    """Print how far proposed places are from the truth, each accepted as it is."""
    truth = json.loads((SAMPLES / "flight" / "truth.json").read_text())
    for camera in CAMERAS:
        for end, track in enumerate(BOTH):
            clicks = [Click(1, camera, track, *truth[camera][0][end])]
            off = []
            for frame in footage.numbers[1:]:
                images = footage.grey(camera, frame - 1), footage.grey(camera, frame)
                place = follow(*images, nearest_clicks(clicks, frame), frame)
                if place is None:
                    print(f"{camera}, {track}: lost in frame {frame}")
                    break
                clicks.append(Click(frame, camera, track, *place))
                off.append(float(np.hypot(*(np.array(place) - truth[camera][frame - 1][end]))))
            print(f"{camera}, {track}: {', '.join(f'{each:.2f}' for each in off)} px")


def answer(store: ProjectClicks, how: ClickMeasure, footage: Footage, click: Click) -> float:
    """CPU seconds from a click to what the page says of it: stored, read, proposed, measured."""
    clicks = store.clicks
    settled = how.settled(clicks)  # again only as the number of points grows by a quarter
    start = time.process_time()
    store.act(Act([click]))
    clicks = store.clicks
    for camera in CAMERAS:
        for track in BOTH:
            near = nearest_clicks(clicks.along(track, camera), 2)
            follow(footage.grey(camera, 1), footage.grey(camera, 2), near, 2)
    measured: MeasuredClicks = how.measured(clicks, settled)
    place = Place(click.track, click.frame)
    measured.sentence(place)
    measured.in_words((place, Place(click.track, click.frame - 1)))
    measured.in_words(*measured.common(*BOTH))
    how.curve(click, CAMERAS[click.camera == CAMERAS[0]])
    return time.process_time() - start


def main() -> None:
    sets = PairAnswer(PairRun(read_dataset(SAMPLES / "field"))).sets
    flights, how = Flights.before_the_field(), ClickMeasure(sets["2d"], sets["refined"])
    for noise_px in (1.0, 0.3):
        lengths(flights, how, noise_px)
    paths = {str(camera): SAMPLES / "flight" / f"{camera}.mp4" for camera in CAMERAS}
    footage = of_videos(paths, {camera: path.name for camera, path in paths.items()})
    drift(footage)
    for frames in (5, 50, 500):
        with tempfile.TemporaryDirectory() as home:
            store = ProjectClicks(Project.create(Path(home)))
            clicks = [*flights.clicks(0, frames, 0.5).every.values()]
            for at in range(0, len(clicks), 4):
                store.act(Act(clicks[at : at + 4]))
            moved = [replace(clicks[4 + k % 4], u=clicks[4 + k % 4].u + 0.1) for k in range(8)]
            seconds = [answer(store, how, footage, click) for click in moved][1:]
        print(f"{len(clicks)} clicks: {np.median(seconds):.3f} s of CPU, most {max(seconds):.3f} s")


if __name__ == "__main__":
    main()
