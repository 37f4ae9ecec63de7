"""Frames of targets with names of their own, from rendered photographs to the table."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TypeVar

import numpy as np

from stereocal.cli import main
from stereocal.detection.balls import choose_balls
from stereocal.detection.target import BRIGHT, Balls, Sighting, Spot, Target, parse_target
from stereocal.formats.correspondences_csv import read_table
from stereocal.frames.frame import Frame
from stereocal.frames.labelling import EXCHANGED, label_frames, without_still
from stereocal.frames.pairing import PhotographPair
from stereocal.rig.camera import Camera
from stereocal.simulation.simulate import place_bars
from stereocal.system.resources import ROOT
from tests.frames.test_frame_detection import detect
from tests.photographs.ball_bars import CAMERA as BALL_CAMERA
from tests.photographs.ball_bars import COLOURS, ball_bars
from tests.photographs.small_rig import BAR_M, RIG, TAGS, photographed_bars

TARGET = parse_target(TAGS)
LENSES = RIG.primary, RIG.secondary
T = TypeVar("T")


def found_frames(
    files: dict[str, bytes],
    folder: Path,
    target: Target = TARGET,
    cameras: tuple[Camera, Camera] = LENSES,
) -> list[Frame]:
    return detect(files, folder, cameras, target, names=files)


def of_two(by_name: Mapping[str, T]) -> dict[str, T]:
    """Of three cameras the first and the last."""
    return {
        name.replace("left", "primary").replace("right", "secondary"): own
        for name, own in by_name.items()
        if not name.startswith("mid")
    }


def test_tags_are_found_and_named(tmp_path: Path) -> None:
    files, truth = photographed_bars(TAGS, 8)
    for frame in found_frames(of_two(files), tmp_path):
        assert frame.state == "found" and frame.use, frame.reason
        for name, centres in zip(frame.files, frame.centres, strict=True):
            found = np.array([(c.u, c.v) for c in centres if c])
            # Measured: 0.04 px at most.
            assert np.abs(found - of_two(truth)[name]).max() < 0.15


def test_what_does_not_fit_the_others_is_doubtful(tmp_path: Path) -> None:
    files = of_two(photographed_bars(TAGS, 8)[0])
    other = {"primary/0002.png": files["primary/0003.png"]}
    mirrored = found_frames(files | other | {"secondary/0004.png": b"a text"}, tmp_path)
    states = {frame.frame: frame.state for frame in mirrored}
    assert states[2] == "doubtful" and states[4] == "refused"
    assert [states[k] for k in (1, 3, 5, 6, 7, 8)] == ["found"] * 6
    assert "secondary/0004.png: " in mirrored[3].reason


def seen_exactly(frames: int) -> tuple[list[PhotographPair], dict[str, Sighting]]:
    """The true image points of bars, as if they had been detected."""
    rng = np.random.default_rng(5)
    pairs, seen = [], {}
    for number, ends in enumerate(place_bars(RIG, rng, frames, BAR_M, (1.2, 2.0)).ends_m, 1):
        pairs.append(PhotographPair(number, f"p{number}", f"s{number}"))
        for name, ends_seen in ((f"p{number}", ends), (f"s{number}", RIG.pose.apply(ends))):
            (u, v), (x, y) = RIG.primary.project(ends_seen) + rng.normal(0.0, 0.05, (2, 2))
            seen[name] = Sighting((Spot(u, v, 0.05, 9.0), Spot(x, y, 0.05, 9.0)), "")
    return pairs, seen


def test_names_exchanged_in_one_photograph_are_doubtful() -> None:
    pairs, seen = seen_exactly(20)
    seen["s7"] = Sighting(seen["s7"].spots[::-1], "")
    frames = label_frames(pairs, seen, (RIG.primary, RIG.primary), TARGET)
    assert [frame.frame for frame in frames if frame.state != "found"] == [7]
    assert EXCHANGED in frames[6].reason and not frames[6].use


def test_one_target_in_both_photographs_is_kept_for_the_user() -> None:
    pairs, seen = seen_exactly(8)
    seen["s3"] = Sighting((seen["s3"].spots[0], None), "No B.")
    seen["s5"] = Sighting((None, None), "Neither.")
    frames = label_frames(pairs, seen, (RIG.primary, RIG.primary), TARGET)
    assert frames[2].targets_in_both == [0] and "Secondary: No B." in frames[2].reason
    assert [frame.state for frame in frames[2:5]] == ["doubtful", "found", "refused"]


def test_balls_are_found_among_clutter(tmp_path: Path) -> None:
    files, truth = ball_bars(6, 7)
    frames = found_frames(files, tmp_path, parse_target(COLOURS), (BALL_CAMERA, BALL_CAMERA))
    wrong = 0
    for frame in frames:
        for name, centres in zip(frame.files, frame.centres, strict=True):
            found = np.array([(c.u, c.v) if c else (np.nan, np.nan) for c in centres])
            wrong += frame.use and not np.abs(found - truth[name]).max() < 1.0
    # Of 200 pairs (`benchmarks.photographs balls-in-clutter`) 98 % right, none wrong and in use.
    assert not wrong and sum(frame.use for frame in frames) >= 5


def test_the_sample_is_found_where_it_is_true(tmp_path: Path) -> None:
    sample, out = ROOT / "sample_data" / "balls", tmp_path / "correspondences.csv"
    assert main(["detect", str(sample), "--target", "balls:red,yellow", "--out", str(out)]) == 0
    rows = read_table(out.read_bytes(), out.name).correspondences
    truth = {
        row["frame"]: row for row in json.loads((sample / "truth.json").read_text())["centres"]
    }
    off = [
        found - truth[int(frame)][which][target]
        for which, points in (("primary", rows.primary), ("secondary", rows.secondary))
        for frame, target, found in zip(rows.frame, rows.target, points, strict=True)
    ]
    # Measured: 20 of 20 frames, 0.11 px rms, 0.35 px at most.
    assert len(rows) >= 36 and np.sqrt(np.square(off).mean()) < 0.2


def test_alike_balls_are_named_by_the_other_frames() -> None:
    pairs, seen = seen_exactly(20)
    spots = {name: [spot for spot in one.spots if spot] for name, one in seen.items()}
    alike = {
        name: choose_balls((tuple(sorted(own, key=lambda spot: spot.u)),))
        for name, own in spots.items()
    }
    frames = label_frames(pairs, alike, (RIG.primary, RIG.primary), Balls((BRIGHT, BRIGHT)))
    used = [frame for frame in frames if frame.use]
    assert len(used) >= 15
    for frame in used:
        first, second = (spots[name] for name in frame.files)
        a, b = (centres[0] for centres in frame.centres)
        assert a and b and (a.u == first[0].u) == (b.u == second[0].u)


def test_what_stands_still_is_not_the_bar() -> None:
    def ball(u: float, score: float) -> Spot:
        return Spot(u, 50.0, 0.1, 10.0, score=score)

    seen = [
        choose_balls(((ball(400.0, 0.99), ball(20.0 * k, 0.9)), (ball(20.0 * k + 200.0, 0.9),)))
        for k in range(10)
    ]
    assert all(one.spots[0] and one.spots[0].u == 400.0 and one.spots[0].doubts for one in seen)
    for k, one in enumerate(without_still(seen)):
        spot = one.spots[0]
        assert spot and spot.u == 20.0 * k and not spot.doubts
