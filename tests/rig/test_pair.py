"""What data sets and correspondences are made of, and what they refuse."""

from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest

from stereocal.errors import RefusedRowsError
from stereocal.fit.calibrate import calibrate_rig
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.correspondences import SHAPES, Correspondences, points_outside
from stereocal.rig.pair import Pair
from tests.refused import refused
from tests.rigs.known_rig import BAR_M, BASELINE_M, PRIMARY, SECONDARY, correspondences, dataset

EXACT = dataset(6)


def changed(**columns: Any) -> Correspondences:
    """The rows of three frames with some columns changed."""
    rows = correspondences(3)
    return replace(rows, **columns)


def check_same(one: Pair, other: Pair) -> None:
    """Check that both have the same digest, rows in the same order, and statements."""
    assert one.sha256 == other.sha256
    for name in ("frame", *SHAPES):
        np.testing.assert_array_equal(
            getattr(one.correspondences, name), getattr(other.correspondences, name)
        )
    assert (one.identity, one.names) == (other.identity, other.names)
    stated = ("start_frames", "step_notes", "beyond_view", "baselines_m")
    told = ([getattr(each.recording, name) for name in stated] for each in (one, other))
    assert next(told) == next(told)


def test_a_recording_holds_all_that_a_table_of_two_cameras_says() -> None:
    rows = changed(
        distance_m=np.array([0.7, 0.7, np.nan, np.nan, 0.8, 0.8]),
        known_points_m=np.arange(18.0).reshape(6, 3),
        sigma_primary_px=np.array([0.1, 0.2, np.nan, 0.4, 0.5, 0.6]),
        sigma_secondary_px=np.array([np.nan, 0.2, 0.3, 0.4, 0.5, 0.6]),
        source=np.array([0, 1, 2, -1, 0, 1]),
        line=np.arange(2, 8),
        time_frame=np.array([10, 10, 14, 14, 18, 18]),
    ).where(np.array([0, 1, 1, 1, 1, 1], dtype=bool))
    stated = EXACT.changed(
        correspondences=rows, notes="windy", baseline_sigma_m=0.01, target_distance_sigma_m=1e-3
    )
    recording = replace(
        stated.recording,
        start_frames={"secondary": 4},
        step_notes=("in step",),
        beyond_view={"primary": 1, "secondary": 0},
    )
    stated = Pair(recording)
    check_same(recording.pair("primary", "secondary"), stated)
    with refused("distance_m", "time_frame", "`calibrate`"):
        calibrate_rig(recording)  # whose fit uses one length
    turned = recording.pair("secondary", "primary").correspondences
    np.testing.assert_array_equal(turned.distance_m, rows.distance_m)
    assert np.isnan(turned.known_points_m).all()  # they are in the primary camera's frame
    late = recording.counted_from({"primary": 3, "secondary": 3}).pair("primary", "secondary")
    np.testing.assert_array_equal(late.correspondences.time_frame, rows.time_frame + 3)
    free = stated.changed(baseline_sigma_m=np.inf)
    check_same(free.recording.pair("primary", "secondary"), free)


class TestCorrespondences:
    def test_bars_are_the_rows_of_A_and_B_in_order_of_the_frames(self) -> None:
        rows = Correspondences.from_arrays(
            [9, 4, 9, 2, 4, 7], ["B", "A", "A", "B", "B", "A"], np.ones((6, 2)), np.ones((6, 2))
        )
        np.testing.assert_array_equal(rows.bars, [[1, 4], [2, 0]])
        np.testing.assert_array_equal(rows.frames, [2, 4, 7, 9])

    def test_a_selection_keeps_rows_whole(self) -> None:
        sigma, source = np.array([0.1, 0.2, np.nan, 0.4, 0.5, 0.6]), np.array([0, 1, 2, -1, 0, 1])
        rows = changed(line=np.arange(2, 8), sigma_secondary_px=sigma, source=source)
        assert rows.has_sigmas and not changed().has_sigmas
        chosen = rows.of_frames([3, 1])
        np.testing.assert_array_equal(chosen.frame, [1, 1, 3, 3])
        np.testing.assert_array_equal(chosen.line, [2, 3, 6, 7])
        np.testing.assert_array_equal(chosen.primary, rows.primary[[0, 1, 4, 5]])
        np.testing.assert_array_equal(chosen.secondary, rows.secondary[[0, 1, 4, 5]])
        np.testing.assert_array_equal(chosen.sigma_secondary_px, sigma[[0, 1, 4, 5]])
        np.testing.assert_array_equal(chosen.source, source[[0, 1, 4, 5]])
        assert np.isnan(chosen.sigma_primary_px).all()
        np.testing.assert_array_equal(rows.without_lines([3, 6]).line, [2, 4, 5, 7])

    def test_copies_are_found_under_other_numbers(self) -> None:
        """Frame 3 is frame 1, its rows in another order; of frame 2 only the primary's image is."""
        rows = changed()
        primary, secondary = np.array(rows.primary), np.array(rows.secondary)
        primary[2:4], primary[[5, 4]], secondary[[5, 4]] = primary[:2], primary[:2], secondary[:2]
        target = np.array([0, 1, 0, 1, 1, 0])
        found = changed(primary=primary, secondary=secondary, target=target)
        assert found.copies == {3: 1}
        assert found.half_copies == {"primary": {2: 1}, "secondary": {}}
        assert not rows.copies and not any(rows.half_copies.values())

    @pytest.mark.parametrize(
        ("columns", "said"),
        [
            ({"frame": np.array([1, 1, 1, 2, 3, 3])}, ["frame", "target twice"]),
            ({"source": np.array([0, 1, 2, -1, 3, 0])}, ["source", "detected, corrected, manual"]),
            ({"sigma_primary_px": np.array([1, 1, 0, 1, 1, np.nan])}, ["standard error", " 0."]),
            ({"sigma_secondary_px": np.array([1, 1, -1, 1, 1, np.nan])}, ["standard error", " 0."]),
            ({"target": np.array([0, 1, 0, 1, 0, 2])}, ["target", "A, B"]),
            ({"target": np.zeros(5, int)}, ["target", "(5,)", "(6,)"]),
            ({"primary": np.full((6, 2), np.nan)}, ["image point", "finite"]),
            ({"secondary": np.full((6, 2), np.inf)}, ["image point", "finite"]),
            ({"secondary": np.ones((6, 3))}, ["secondary", "(6, 3)", "(6, 2)"]),
            ({"distance_m": np.ones((6, 1))}, ["distance_m", "(6, 1)", "(6,)"]),
        ],
    )
    def test_refusals(self, columns: dict[str, Any], said: list[str]) -> None:
        with refused(*said):
            changed(**columns)


class TestLengths:
    @pytest.mark.parametrize(
        ("name", "value", "said"),
        [
            ("baseline_sigma_m", 5.0, ["baseline", " 5 m", "millimetres", "0.005 m"]),
            ("target_distance_sigma_m", 1.0, ["targets", " 1 m", "millimetres", "0.001 m"]),
            ("baseline_sigma_m", 0.21 * BASELINE_M, ["baseline", "0.4977 m", "20 %"]),
            ("baseline_sigma_m", 1e-300, ["baseline", "1e-300 m", "2e-07 m"]),
            ("target_distance_sigma_m", 1e-300, ["targets", "1e-300 m", "9e-08 m"]),
            ("baseline_m", -4.5, ["baseline", "-4.5 m"]),
            ("baseline_m", 4500.0, ["baseline", "4500 m", "millimetres", "(4.5)"]),
            ("target_distance_m", 0.0, ["targets", " 0 m"]),
            ("target_distance_m", 1500.0, ["targets", "1500 m", "millimetres", "(1.5)"]),
        ],
    )
    def test_an_impossible_length_or_uncertainty_asks_for_its_unit(
        self, name: str, value: float, said: list[str]
    ) -> None:
        with refused(*said):
            EXACT.changed(**cast(Any, {name: value}))

    def test_a_bar_in_millimetres_is_named_where_it_gives_the_baseline(self) -> None:
        scaled = {"baseline_m": 1000 * BASELINE_M, "target_distance_m": 1000 * BAR_M}
        with refused("870 m", "2370 m", "millimetres", f"({BAR_M:g})"):
            EXACT.changed(**cast(Any, scaled), baseline_sigma_m=np.inf)

    def test_a_frames_own_distance_goes_before_the_data_sets(self) -> None:
        """Given with A, with B, with both, and with none."""
        nan = np.nan
        rows = correspondences(4)
        rows = replace(rows, distance_m=np.array([0.5, nan, nan, 0.6, 0.7, 0.7, nan, nan]))
        own = EXACT.changed(correspondences=rows)
        np.testing.assert_array_equal(own.bar_distances_m, [0.5, 0.6, 0.7, BAR_M])


class TestPointsOutside:
    @pytest.mark.parametrize("camera", ["primary", "secondary"])
    @pytest.mark.parametrize("axis", [0, 1])
    def test_the_last_half_pixel_is_inside(self, camera: str, axis: int) -> None:
        size = {"primary": PRIMARY, "secondary": SECONDARY}[camera].image_size[axis]
        for value, outside in (
            (-0.5, False),
            (-0.51, True),
            (size - 0.5, False),
            (size - 0.49, True),
        ):
            points = np.array(getattr(correspondences(3), camera))
            points[4, axis] = value
            problems = points_outside(
                changed(**{camera: points}, line=np.arange(2, 8)), PRIMARY, SECONDARY
            )
            assert [problem.line for problem in problems] == [6] * outside
            if outside:
                assert f"frame 3, target A: the {camera} point" in problems[0].reason

    def test_are_refused_with_all_of_them_named(self) -> None:
        points = np.array(correspondences(3).secondary)
        points[1:] = 5000.0
        rows = changed(secondary=points, line=np.arange(2, 8))
        with pytest.raises(RefusedRowsError) as e:
            EXACT.changed(correspondences=rows)
        assert [problem.line for problem in e.value.problems] == [3, 4, 5, 6, 7]
        assert "exchanged" not in str(e.value)

    @pytest.mark.parametrize(
        ("names", "said"), [(CAMERAS, "The secondary"), (("L", "Rr"), "Camera Rr")]
    )
    def test_a_lens_that_cannot_be_inverted_is_named(
        self, names: tuple[str, str], said: str
    ) -> None:
        folded = replace(SECONDARY, distortion=np.array([-9.0, 0.0, 0.0, 0.0]))
        with refused(said, "frame 1, target A", "1280x1024 px"):
            replace(EXACT.recording, cameras=dict(zip(names, (PRIMARY, folded), strict=True))).pair(
                *names
            )


class TestPair:
    def test_rays_are_those_of_each_camera(self) -> None:
        np.testing.assert_array_equal(
            EXACT.rays[:2].T, PRIMARY.undistort(EXACT.correspondences.primary)
        )
        np.testing.assert_array_equal(
            EXACT.rays[2:].T, SECONDARY.undistort(EXACT.correspondences.secondary)
        )
        np.testing.assert_array_equal(EXACT.pixel_scale[1], [1190.6, 2.3, 1171.9])

    def test_targets_exchanged(self) -> None:
        """Of the frames asked for, in the secondary image alone; twice is as before."""
        sound = EXACT.correspondences
        once = EXACT.with_targets_exchanged([2, 3])
        rows = once.correspondences
        np.testing.assert_array_equal(rows.primary, sound.primary)
        a, b = sound.bars[1]
        np.testing.assert_array_equal(rows.secondary[[a, b]], sound.secondary[[b, a]])
        np.testing.assert_array_equal(
            rows.secondary[rows.frame == 1], sound.secondary[sound.frame == 1]
        )
        twice = once.with_targets_exchanged([2, 3])
        assert twice.sha256 == EXACT.sha256 != once.sha256

    def test_the_digest_is_of_the_numbers(self) -> None:
        assert dataset(6).sha256 == EXACT.sha256
        assert EXACT.changed(name="another", notes="x").sha256 == EXACT.sha256
        rows = correspondences(6)
        nudged = np.array(rows.secondary)
        nudged[3, 1] = np.nextafter(nudged[3, 1], 0)
        distances = np.array(rows.distance_m)
        distances[0] = BAR_M
        others = [
            EXACT.changed(baseline_m=np.nextafter(EXACT.baseline_m, 0)),
            EXACT.changed(target_distance_m=0.5),
            EXACT.changed(correspondences=replace(rows, secondary=nudged)),
            EXACT.changed(correspondences=replace(rows, distance_m=distances)),
            EXACT.changed(primary=Camera(PRIMARY.K, np.zeros(0), PRIMARY.image_size)),
            EXACT.of_frames([1, 2, 3, 4, 5]),
            dataset(6, known_points=True),
            EXACT.changed(correspondences=replace(rows, sigma_primary_px=np.full(12, 0.1))),
        ]
        assert len({EXACT.sha256, *(other.sha256 for other in others)}) == 1 + len(others)

    def test_of_frames_keeps_the_rest(self) -> None:
        part = EXACT.of_frames([2, 5])
        np.testing.assert_array_equal(part.correspondences.frames, [2, 5])
        np.testing.assert_array_equal(part.rays, EXACT.rays[:, [2, 3, 8, 9]])
        assert isinstance(part, Pair)
        assert part.baseline_m == EXACT.baseline_m
