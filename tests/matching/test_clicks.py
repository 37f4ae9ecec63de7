"""Points clicked in two images: the line in the other, what they measure, the next place."""

import re
from dataclasses import replace
from itertools import product

import cv2
import numpy as np
import pandas as pd
import pytest

from stereocal.fit.parameter_file import refined_parameters
from stereocal.fit.refine import refine
from stereocal.fit.rig_file import RigFile
from stereocal.library.tables import match, reconstruct
from stereocal.matching.clicks import (
    CLICK_PX,
    DRIFT_PX,
    Click,
    ClickMeasure,
    Clicks,
    MeasuredClicks,
    Place,
)
from stereocal.matching.following import Image, corner_at, follow, nearest_clicks
from stereocal.matching.settled import Settled, Stated
from stereocal.rig.camera import CAMERAS, Camera, CameraName
from stereocal.rig.correspondences import PIXELS
from stereocal.rig.epipolar_curve import epipolar_curve
from stereocal.rig.geometry import Pose
from stereocal.rig.parameters import RigParameters
from stereocal.rig.rig import Rig
from stereocal.rig.tracks import MeasuredOffset
from stereocal.rig.volume import Volume
from stereocal.system.array_types import FloatArray
from tests.projects.test_recording import rig_text
from tests.refused import refused
from tests.rigs.known_rig import PRIMARY, RIG, SECONDARY, dataset, images

SET = RigParameters(PRIMARY, SECONDARY, RIG, "refined", 1.0, {}, {}, matching_threshold_px=0.4)
EQUIDISTANT = np.array([[300.0, 0, 640], [0, 300, 512], [0, 0, 1]])
FISHEYE = Camera(EQUIDISTANT, np.zeros(4), (1280, 1024), model="fisheye")
LENGTH_M = 0.25


def flight(frames: int, noise_px: float = 0.0, seed: int = 0, length_m: float = LENGTH_M) -> Clicks:
    """Head and tail of something that flies straight on, clicked in both images."""
    rng = np.random.default_rng(seed)
    clicks = []
    for frame in range(1, frames + 1):
        head = np.array([-0.6 + 0.08 * frame, 0.2, 7.0 + 0.05 * frame])
        for track, point in (("head", head), ("tail", head + np.array([0.0, length_m, 0.0]))):
            for camera, pixels in zip(CAMERAS, images(point[None]), strict=True):
                u, v = pixels[0] + noise_px * rng.standard_normal(2)
                clicks.append(Click(frame, camera, track, float(u), float(v)))
    return Clicks.of(clicks)


def off(curve: FloatArray, pixel: FloatArray) -> float:
    """Distance of a pixel from a curve."""
    start, along = curve[:-1], np.diff(curve, axis=0)
    share = np.einsum("ni,ni->n", pixel - start, along) / np.square(along).sum(axis=1)
    near = start + np.clip(share, 0, 1)[:, None] * along
    return float(np.linalg.norm(near - pixel, axis=1).min())


@pytest.mark.parametrize(
    "rig", [SET, Rig(FISHEYE, SECONDARY, RIG), Rig(PRIMARY, FISHEYE, RIG)], ids=["usual", "1", "2"]
)
def test_the_epipolar_line_passes_the_partner_in_the_recorded_image(rig: Rig) -> None:
    points = np.random.default_rng(3).uniform([-1.3, -1.1, 6.0], [1.3, 1.0, 10.5], (12, 3))
    pixels = rig.primary.project(points), rig.secondary.project(RIG.apply(points))
    seen = dict(zip(CAMERAS, pixels, strict=True))
    for camera, other in (CAMERAS, CAMERAS[::-1]):
        curves = [epipolar_curve(rig, camera, other, pixel) for pixel in seen[camera]]
        worst = max(map(off, curves, seen[other]))
        assert worst < 0.01  # measured: 0.0005
        width, height = getattr(rig, other).image_size
        ends = np.array([curve[[0, -1]] for curve in curves]).reshape(-1, 2)
        assert (ends >= -0.5).all() and (ends <= [width - 0.5, height - 0.5]).all()
        assert all(len(curve) > 50 for curve in curves)
    straight = np.linalg.norm(np.diff(curves[0][[0, -1]], axis=0))
    bent = off(curves[0][[0, -1]], curves[0][len(curves[0]) // 2])
    assert bent > 1.0 and straight > 100  # curved where lenses distort


def test_no_line_where_the_other_camera_sees_nothing() -> None:
    away = Rig(PRIMARY, SECONDARY, Pose(np.diag([-1.0, 1.0, -1.0]), np.array([2.0, 0, 0])))
    assert epipolar_curve(away, "primary", "secondary", [800.0, 600.0]).shape == (0, 2)


def test_clicks_measure_what_match_and_reconstruct_do() -> None:
    clicks, how = flight(12, 0.5), ClickMeasure(SET, SET)
    settled = how.settled(clicks)
    found = how.measured(clicks, settled)
    assert 0.3 < settled.sigma_px < 0.7  # estimated; truth: 0.5
    pairs = match(SET, clicks.tables(CAMERAS), names="track")
    same = pairs.sort_values(["frame", "track_primary"], ignore_index=True)
    np.testing.assert_allclose(found.pixels.reshape(-1, 4), same[list(PIXELS)])
    np.testing.assert_allclose(found.errors_px[0], same["error_px"], atol=1e-6)
    agrees(found, reconstruct(SET, same))
    # One more in the primary only is no pair, and takes nobody's partner.
    more = clicks.placed([Click(1, "primary", "wing", 700.0, 500.0)])
    assert len(how.measured(more, settled).places) == len(pairs)
    assert len(more.tables(CAMERAS)["primary"]) == 25
    assert len(more.tables(CAMERAS, to_match=True)["primary"]) == 24


def agrees(found: MeasuredClicks, points: pd.DataFrame) -> None:
    """Whether the sentences have the positions and standard errors of a table."""
    ordered = points.sort_values(["frame", "track"], ignore_index=True)
    names = zip(ordered["track"].tolist(), ordered["frame"].tolist(), strict=True)
    assert [*found.rows] == [Place(*each) for each in names] and len(found.rows) > 9
    for place, row in [*found.rows.items()][::9]:
        words = found.sentence(place)
        for axis in "xyz":
            value, sigma = map(float, re.findall(rf"{axis} ([-\d.]+) ± ([\d.]+) m", words)[0])
            own = ordered.iloc[row]
            assert abs(value - own[axis]) < 0.2 * own[f"sigma_{axis}"]
            assert sigma == pytest.approx(own[f"sigma_{axis}"], rel=0.05)


def test_few_clicks_count_as_clicked_by_hand() -> None:
    settled = ClickMeasure(replace(SET, noise_px=0.02), SET).settled(flight(2, 0.3))
    assert settled.sigma_px == CLICK_PX
    assert 1.5 < settled.threshold_px < 2.2
    stated = ClickMeasure(SET, SET, Stated(sigma_px=0.05, names="track")).settled(flight(2))
    assert stated.threshold_px == 0.4  # that of the file is larger


def test_a_length_and_its_error() -> None:
    """The error of the mean of five lengths, of 60 flights: as large as it is said to be."""
    relative = []
    for seed in range(60):
        clicks = flight(5, 1.0, seed)
        how = ClickMeasure(SET, SET, Stated(1.8, sigma_px=1.0, names="track"))
        found = how.measured(clicks, Settled(1.0, 1.8))
        length = found.length(*found.common("head", "tail"))
        assert length is not None and length.frames == 5
        relative.append((length.metres - LENGTH_M) / length.sigma_m)
    assert 0.75 < float(np.sqrt(np.mean(np.square(relative)))) < 1.25  # measured: 0.98
    place = Place("head", 3)
    assert found.previous(place) == Place("head", 2)
    step = found.length((place, Place("head", 2)))
    assert step is not None and step.metres == pytest.approx(np.hypot(0.08, 0.05), abs=0.03)
    assert found.length((place, place)) is None and found.length((place, Place("x", 1))) is None
    assert " px, below the threshold of 1.8 px. x " in found.sentence(place)
    far = replace(SET, volume=Volume((-1.0, 1.0), (-1.0, 1.0), (8.0, 9.0)))
    outside = ClickMeasure(SET, far).measured(clicks, found.settled).sentence(place)
    assert outside.endswith("m, outside the volume of the calibration.")


def of_independent(found: MeasuredClicks, *ends: tuple[Place, Place]) -> float:
    """The standard error of a mean length if all pixels are independent."""
    one, other = np.array([[found.rows[place] for place in both] for both in ends]).T
    apart = found.fits.xyz[one] - found.fits.xyz[other]
    along = apart / np.linalg.norm(apart, axis=1, keepdims=True)
    of_pixels, by_shared, shared = found.fits.errors
    variance = np.einsum("ni,nij,nj->", along, of_pixels[one] + of_pixels[other], along)
    sums = np.einsum("ni,niq->q", along, by_shared[one] - by_shared[other])
    return float(np.sqrt(variance + sums @ shared @ sums)) / len(one)


def followed(every: int, seed: int) -> Clicks:
    """Something of 1 m in 20 frames: clicked by hand to 1 px in each image once in so many of them,
    not in the same ones, and followed from there."""
    rng, clicks = np.random.default_rng(seed), list[Click]()
    errors, origins = dict[tuple[str, str], FloatArray](), dict[tuple[str, str], int]()
    phases: dict[tuple[str, str], int] = {
        image: number for number, image in enumerate(product(CAMERAS, ("head", "tail")))
    }
    for click in flight(20, length_m=1.0).every.values():
        image = click.camera, click.track
        by_hand = click.frame == 1 or (click.frame - 1 - phases[image] * (every < 20)) % every == 0
        if by_hand:
            errors[image], origins[image] = rng.normal(0.0, 1.0, 2), click.frame
        else:
            errors[image] = errors[image] + rng.normal(0.0, DRIFT_PX, 2)
            click = replace(click, source="followed", origin=origins[image])
        u, v = errors[image].tolist()
        clicks.append(replace(click, u=click.u + u, v=click.v + v))
    return Clicks.of(clicks)


@pytest.mark.parametrize(("every", "before"), [(20, 4.0), (6, 2.0), (1, 0.8)])
def test_places_followed_from_one_click_share_its_error(every: int, before: float) -> None:
    """Errors of mean lengths and of steps over the stated ones, of 100 flights; before, those of
    the lengths by independent pixels."""
    how = ClickMeasure(SET, SET, Stated(1.8, sigma_px=1.0, names="track"))
    relative, step_m = [], 5 * np.hypot(0.08, 0.05)
    for seed in range(100):
        found = how.measured(followed(every, seed), Settled(1.0, 1.8))
        ends = found.common("head", "tail")
        length, step = found.length(*ends), found.length((Place("head", 18), Place("head", 13)))
        assert length is not None and length.frames == 20 and step is not None
        independent, error = of_independent(found, *ends), length.metres - 1.0
        relative.append(
            [error / independent, error / length.sigma_m, (step.metres - step_m) / step.sigma_m]
        )
        if every == 1:
            assert length.sigma_m == pytest.approx(independent, rel=0.01)
    rms = np.sqrt(np.mean(np.square(relative), axis=0))
    # Measured: 5.2, 0.98, 0.99 followed from one frame; 2.4, 0.98, 1.01; and 1.09, 1.09, 0.98.
    assert rms[0] > before and (rms[1:] > 0.8).all() and (rms[1:] < 1.3).all()


def test_the_noise_of_few_clicks_is_not_that_of_what_follows_them() -> None:
    """Errors of the same four clicks in 40 points look small, or large, together."""
    clicks = Clicks.of(
        replace(click, source="followed" if click.frame > 1 else "clicked")
        for click in flight(20).every.values()
    )
    assert {*clicks.origins.values()} == {1}  # as of earlier versions, which did not keep them
    how, settled = ClickMeasure(SET, SET), Settled(0.02, 0.4)
    assert how.measured(clicks, settled).click_px == CLICK_PX
    assert how.measured(flight(20), settled).click_px == 0.02
    stated = ClickMeasure(SET, SET, Stated(sigma_px=0.02, names="track"))
    assert stated.measured(clicks, settled).click_px == 0.02
    assert how.measured(flight(2), settled).click_px == 0.02


@pytest.mark.parametrize(("kept", "origin"), [(1, 1), (None, 2)])
def test_a_place_keeps_its_click_when_one_before_it_is_corrected(
    kept: int | None, origin: int
) -> None:
    first, second, third = (Click(frame, "primary", "head", 9.0, 9.0) for frame in (1, 2, 3))
    third = replace(third, source="followed", origin=kept)
    clicks = Clicks.of([third, second, first])
    assert [clicks.origins[e.key] for e in (first, second, third)] == [1, 2, origin]


@pytest.mark.parametrize(("known", "mostly"), [(None, True), (0.0001, False)])
def test_a_distance_says_that_its_error_is_mostly_the_bars(
    known: float | None, mostly: bool
) -> None:
    """0.25 m in sharp images, of a bar that is taken as known to 0.1 %, or is to 0.01 %."""
    data = dataset(25, 0.005)
    sigma = None if known is None else known * data.target_distance_m
    file = refined_parameters(refine(data.changed(target_distance_sigma_m=sigma)))
    found = ClickMeasure(file, file).measured(flight(1), Settled(0.02, 0.4))
    length = found.length(*found.common("head", "tail"))
    assert length is not None
    # The baseline is free within 1 %: nothing but the bar has the scale.
    assert length.scale_m == pytest.approx((known or 0.001) * LENGTH_M, rel=0.02)
    assert length.sigma_m > length.scale_m
    assert ("from the bar" in found.in_words(*found.common("head", "tail"))) is mostly


def test_a_distance_near_0_has_the_error_of_its_position() -> None:
    """At 0 it has no direction; one such frame leaves the mean of five, and its error, finite."""
    clicks, how = flight(5, 0.5), ClickMeasure(SET, SET)
    usual = how.measured(clicks, Settled(1.0, 1.8))
    four = usual.length(*usual.common("head", "tail")[1:])
    heads = [clicks.every[1, camera, "head"] for camera in CAMERAS]
    for shift_px in (0.0, 1e-9, 0.3):
        same = [replace(head, track="tail", u=head.u + shift_px) for head in heads]
        found = how.measured(clicks.placed(same), Settled(1.0, 1.8))
        both = found.common("head", "tail")
        one, five = found.length(both[0]), found.length(*both)
        assert one is not None and four is not None and five is not None and five.frames == 5
        assert found.points.sigma_m is not None and one.metres < 0.01
        of_head = float(np.linalg.norm(found.points.sigma_m[found.rows[Place("head", 1)]]))
        assert one.sigma_m == pytest.approx(np.sqrt(2) * of_head, rel=1e-3)
        assert five.metres == pytest.approx((4 * four.metres + one.metres) / 5)
        assert five.sigma_m == pytest.approx((4 * four.sigma_m + one.sigma_m) / 5)


def test_the_line_is_where_the_other_camera_sees_the_point_then() -> None:
    late = replace(SET, time_offset=MeasuredOffset(0.5, sigma=0.01))
    points = np.array([[0.0, 0.1, 7.0], [0.1, 0.2, 7.1]])
    first, second = images(points)
    between = images(points.mean(axis=0, keepdims=True))[1][0]
    click = Click(1, "primary", "head", *first[0].tolist())
    how = ClickMeasure(late, late)
    curves = [how.curve(click, "secondary", speed) for speed in (first[1] - first[0], None)]
    assert off(curves[0], between) < 0.5 < off(curves[1], between)
    back = Click(1, "secondary", "head", *between.tolist())
    assert off(how.curve(back, "primary", second[1] - second[0]), first[0]) < 0.5


def test_line_and_position_of_a_rig_are_both_of_the_points_in_step() -> None:
    rig = replace(RigFile.loads(rig_text()), time_offsets={"1": 0.0, "2": 0.5, "3": 0.0})
    assert rig.volume is not None
    middle = np.array([sum(ends) / 2 for ends in vars(rig.volume).values()])
    late = {"2": 0.5}
    clicks = Clicks.of(
        Click(frame, name, "head", *own.camera.project(own.pose.apply(at[None]))[0].tolist())
        for name, own in rig.placed.items()
        for frame in range(12)
        for at in [middle + (frame + late.get(name, 0.0)) * np.array([0.02, 0.01, -0.01])]
    )
    how = ClickMeasure(rig, rig)
    found = how.measured(clicks, Settled(CLICK_PX))
    # Measured: below 1e-6 px; as recorded 0.7 px. The first has no neighbour before it.
    assert found.errors_px[0][2:].max() < 1e-3
    first, second = (clicks.every[2, name, "head"] for name in "12")
    before = clicks.every[1, "1", "head"]
    line = how.curve(first, "2", np.array([first.u - before.u, first.v - before.v]))
    assert off(line, np.array([second.u, second.v])) < 0.1
    assert "shifted in time" in found.timing


def picture(shift: tuple[float, float], seed: int = 0, camera: CameraName = "primary") -> Image:
    """A still background, and something of 24 px that has moved."""
    rng = np.random.default_rng([seed, CAMERAS.index(camera)])
    behind, thing = (
        cv2.GaussianBlur(rng.normal(120, sigma, (300, 400)), (0, 0), blur)
        for sigma, blur in ((60, 3), (160, 2))
    )
    circle = cv2.circle(np.zeros((300, 400)), (150, 150), 14, 1.0, -1)
    circle = cv2.GaussianBlur(circle, (0, 0), 1)
    by = np.array([[1, 0, shift[0]], [0, 1, shift[1]]], np.float64)
    thing, inside = (cv2.warpAffine(each, by, (400, 300)) for each in (thing, circle))
    mixed = inside * thing + (1 - inside) * behind + rng.normal(0, 2, inside.shape)
    return np.clip(mixed, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("seed", range(4))
def test_the_next_place_is_found_in_the_image(seed: int) -> None:
    steps = [(0.0, 0.0), (11.3, -4.6), (24.9, -7.2)]
    clicks = [Click(k, "primary", "a", 150 + s[0], 150 + s[1]) for k, s in enumerate(steps[:2])]
    before, now = (picture(step, seed) for step in steps[1:])
    for known in (clicks, clicks[1:]):
        found = follow(before, now, nearest_clicks(known, 2), 2)
        # Measured: 0.09 to 0.12 px.
        assert found is not None and np.hypot(found[0] - 174.9, found[1] - 142.8) < 0.3
    # It has gone.
    assert follow(before, picture((180.0, 100.0), seed), nearest_clicks(clicks, 2), 2) is None


def test_a_click_goes_to_the_corner_there() -> None:
    image = np.full((80, 120), 60, np.uint8)
    image[30:, 50:] = 200  # edges meet between the pixels 29 and 30, 49 and 50
    assert corner_at(image, (51.0, 28.0)) == pytest.approx((49.5, 29.5), abs=0.1)
    with refused("corner"):
        corner_at(image, (20.0, 60.0))
    with refused("outside"):
        corner_at(image, (200.0, 60.0))


def test_the_nearest_clicks_are_on_one_side() -> None:
    clicks = [Click(frame, "primary", "a", float(frame), 0.0) for frame in (1, 2, 7, 8)]
    assert [each.frame for each in nearest_clicks(clicks, 3)] == [2, 1]
    assert [each.frame for each in nearest_clicks(clicks, 6)] == [7, 8]
    assert nearest_clicks([], 3) == [] == nearest_clicks(clicks, 19)
