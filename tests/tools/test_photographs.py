"""Photographs of the bar, their backgrounds, what spoils them, and the sample that is shipped."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from stereocal.detection.detect import detect_targets
from stereocal.formats.camera_file import read_camera
from stereocal.rig.rig import Rig
from stereocal.simulation.simulate import FIELD_BAR_M, Scene, field_rig
from stereocal.system.array_types import FloatArray
from stereocal.system.photograph import read_colours, read_photograph
from tests.further import further
from tests.photographs.bars import small
from tests.simulation.test_simulate import assert_same_numbers
from tools.photographs.__main__ import main
from tools.photographs.ball_sample import write_ball_sample
from tools.photographs.bars import (
    SAMPLE_FLAWS,
    BarSettings,
    Flaw,
    PhotographPair,
    photograph_bars,
    place_visible_bars,
)
from tools.photographs.rendering import HERE, Photograph, PhotographSettings
from tools.photographs.sample import describing_files, prepare_photographs
from tools.photographs.tank_sample import sample_rig as tank_rig
from tools.photographs.tank_sample import write_tank_sample

SHIPPED = Path(__file__).parents[2] / "sample_data" / "photographs"
PLAIN = PhotographSettings(read_noise=0.0, full_well_e=np.inf, vignetting=0.0)


def small_scene(seed: int, frames: int) -> Scene:
    """The field rig with a quarter of its pixels in each direction, and bars in view."""
    rig = field_rig()
    shrunk = Rig(small(rig.primary), small(rig.secondary), rig.pose)
    return place_visible_bars(
        shrunk, np.random.default_rng(seed), frames, FIELD_BAR_M, 0.3, (6.0, 9.0), margin_px=50.0
    )


def is_x_corner(image: Photograph, centre: FloatArray, reach: int = 4) -> bool:
    """Whether a window about a place has contrast and looks the same when turned by 180 degrees."""
    side = 2 * reach + 1
    window = cv2.getRectSubPix(image.astype(np.float32), (side, side), centre.tolist())
    grey = np.asarray(window, dtype=np.float64)
    grey -= grey.mean()
    turned_half = (grey * grey[::-1, ::-1]).sum() / (grey**2).sum()
    return bool(grey.std() > 30.0 and turned_half > 0.9)


def test_each_pair_shows_the_targets_at_the_true_centres() -> None:
    scene = small_scene(1, 12)
    bar = BarSettings(board_m=0.3, tilt_rad=(0.0, 0.6))
    pairs = list(photograph_bars(scene, (120.0, 90.0), bar, PLAIN, np.random.default_rng(2)))
    assert [pair.frame for pair in pairs] == list(range(1, 13))
    for pair, ends in zip(pairs, scene.ends_m, strict=True):
        moved = scene.rig.pose.apply(ends)
        np.testing.assert_allclose(pair.centres_primary, scene.rig.primary.project(ends))
        np.testing.assert_allclose(pair.centres_secondary, scene.rig.secondary.project(moved))
        for which in ("primary", "secondary"):
            image, centres = getattr(pair, which), getattr(pair, f"centres_{which}")
            assert image.shape == (432, 584)
            assert all(is_x_corner(image, centre) for centre in centres)
            assert not is_x_corner(image, centres.mean(axis=0))
        assert (pair.primary[0, 0], pair.secondary[0, 0]) == (120, 90)


def test_command_writes_the_photographs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tools.photographs.sample.outdoors", lambda *_: (120.0, 90.0))
    monkeypatch.setattr("tools.photographs.sample.indoors", lambda *_: 125.0)
    main(["--out", str(tmp_path / "photographs"), "--frames", "1", "--boards", "1", "--seed", "3"])
    assert "4 photographs: done" in capsys.readouterr().err
    folder = tmp_path / "photographs"
    files = {str(file.relative_to(folder)) for file in folder.rglob("*") if file.is_file()}
    folders = ("primary", "secondary", "boards_primary", "boards_secondary")
    described = {f"{name}.json" for name in ("dataset", "primary", "secondary", "truth")}
    assert files == described | {f"{name}/0001.jpg" for name in folders}
    (frame,) = json.loads((folder / "truth.json").read_text())["frames"]
    for which in ("primary", "secondary"):
        image = np.asarray(cv2.imread(str(folder / which / "0001.jpg"), cv2.IMREAD_UNCHANGED))
        assert image.shape == (1728, 2336)
        for target in "AB":
            assert is_x_corner(image, np.array(frame[f"pixels_{which}"][target]))


def test_shipped_truth_is_what_the_code_makes() -> None:
    """Numbers and not bytes: another processor may round the last digit otherwise."""
    truth = json.loads((SHIPPED / "truth.json").read_text())
    field = prepare_photographs(truth["seed"])
    for name, content in describing_files(field).items():
        shipped = (SHIPPED / name).read_bytes()
        assert_same_numbers(json.loads(shipped), json.loads(content))
    for which, camera in field.cameras.items():
        given = read_camera((SHIPPED / f"{which}.json").read_bytes(), which)
        assert given.to_json() == camera.to_json()
    names = {f"{number:04d}.jpg" for number in range(1, 26)}
    for which in ("primary", "secondary"):
        assert {file.name for file in (SHIPPED / which).iterdir()} == names
        assert len(list((SHIPPED / f"boards_{which}").iterdir())) == 22
    size = sum(file.stat().st_size for file in SHIPPED.parent.rglob("*") if file.is_file())
    assert size < 12_100_000


def test_shipped_photographs_show_what_the_code_makes() -> None:
    """The first of the chessboard and of the bar, apart from what JPEG changes."""
    field = prepare_photographs(json.loads((SHIPPED / "truth.json").read_text())["seed"])
    pair = next(field.pairs())
    for image, name in (
        (pair.primary, "primary/0001.jpg"),
        (next(field.board_photographs("secondary")), "boards_secondary/0001.jpg"),
    ):
        shipped = np.asarray(cv2.imread(str(SHIPPED / name), cv2.IMREAD_UNCHANGED))
        assert shipped.shape == (1728, 2336)
        difference = shipped.astype(float) - image
        # JPEG smooths the noise of 1.9 grey levels away and little else.
        assert np.abs(difference).mean() < 2.0
        assert np.abs(difference).max() < 40.0
    for centre in pair.centres_primary:
        assert is_x_corner(pair.primary, centre)


def test_the_sample_of_balls_is_made_by_its_tool(tmp_path: Path) -> None:
    write_ball_sample(tmp_path, frames=1)
    shipped = SHIPPED.parent / "balls"
    for name in ("dataset.json", "primary.json", "secondary.json"):
        assert (tmp_path / name).read_bytes() == (shipped / name).read_bytes()
    image = read_colours(tmp_path / "primary" / "0001.jpg")
    truth = json.loads((tmp_path / "truth.json").read_text())["centres"][0]["primary"]
    for (u, v), brightest in zip(truth, (2, 1), strict=True):  # red; yellow has little blue
        blue_green_red = image[round(v), round(u)].astype(int)
        assert blue_green_red[2] > 60 > blue_green_red[0] - 60
        assert blue_green_red[brightest] > blue_green_red[0] + 20


def test_the_sample_in_a_tank_is_made_by_its_tool(tmp_path: Path) -> None:
    write_tank_sample(tmp_path, frames=1)
    shipped = SHIPPED.parent / "tank"
    for name in ("dataset.json", "primary.json", "secondary.json"):
        assert (tmp_path / name).read_bytes() == (shipped / name).read_bytes()
    truth = json.loads((tmp_path / "truth.json").read_text())
    rig = tank_rig()
    ends = np.array(truth["ends_m"][0])
    for camera, pose, which in (
        (rig.primary, HERE, "primary"),
        (rig.secondary, rig.pose, "secondary"),
    ):
        through = camera.project(pose.apply(ends))
        image = read_photograph(tmp_path / which / "0001.jpg")
        targets = detect_targets(image).targets
        assert targets is not None
        found = np.array([target.centre for target in targets])
        apart = np.linalg.norm(found[:, None] - through, axis=2).min(axis=0)
        # Measured on the 48 photographs: 0.010 px in the median, 0.029 px at most.
        assert apart.max() < 0.05
        straight = replace(camera, window=None).project(pose.apply(ends))
        assert np.linalg.norm(straight - through, axis=1).min() > 20.0


BAR = BarSettings(board_m=0.3, tilt_rad=(0.0, 0.3))
MOTION = Flaw("motion", motion_m=(0.03, 0.0, 0.0))


@cache
def taken(flaw: Flaw | None = None) -> list[PhotographPair]:
    """Three frames, the second with a flaw if there is one."""
    flaws = {2: flaw} if flaw else {}
    rng = np.random.default_rng(2)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tools.photographs.bars.MOTION_STEPS", 11)  # 0.7 px each
        return list(photograph_bars(small_scene(1, 3), (120.0, 90.0), BAR, PLAIN, rng, flaws))


@pytest.mark.parametrize(
    "flaw", [MOTION, *further(Flaw("glare", glare=90.0), Flaw("leaf", leaf=1.7))]
)
def test_only_the_frame_concerned_changes(flaw: Flaw) -> None:
    for sound, other in zip(taken(), taken(flaw), strict=True):
        same = [
            np.array_equal(sound.primary, other.primary),
            np.array_equal(sound.secondary, other.secondary),
        ]
        assert not same[0] if sound.frame == 2 else all(same)
        np.testing.assert_array_equal(sound.centres_primary, other.centres_primary)


def test_motion_blurs_along_its_direction_and_leaves_the_centre() -> None:
    sound, other = taken()[1], taken(MOTION)[1]
    for images in ((sound.primary, other.primary), (sound.secondary, other.secondary)):
        along, across = (
            np.abs(np.diff(images[1].astype(float), axis=axis)).max()
            / np.abs(np.diff(images[0].astype(float), axis=axis)).max()
            for axis in (1, 0)
        )
        assert along < 0.8
        assert across > along
    assert all(is_x_corner(other.primary, centre, 8) for centre in other.centres_primary)


def test_the_sample_has_three_doubtful_frames_and_a_refused_one() -> None:
    """As detection sees them; it finds both targets of all other frames without doubt."""
    found = {}
    for frame in SAMPLE_FLAWS:
        for which in ("primary", "secondary"):
            image = cv2.imread(str(SHIPPED / which / f"{frame:04d}.jpg"), cv2.IMREAD_UNCHANGED)
            found[frame, which] = detect_targets(np.asarray(image)).state
    assert {key: state for key, state in found.items() if state != "found"} == {
        (9, "secondary"): "doubtful",
        (11, "primary"): "doubtful",
        (11, "secondary"): "doubtful",
        (19, "primary"): "refused",
        (22, "primary"): "doubtful",
    }
    frames = json.loads((SHIPPED / "truth.json").read_text())["frames"]
    stated = {each["frame"]: each["flaw"] for each in frames if "flaw" in each}
    assert stated == {frame: flaw.what for frame, flaw in SAMPLE_FLAWS.items()}
