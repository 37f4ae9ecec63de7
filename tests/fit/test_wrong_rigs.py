"""Wrong inputs of a rig: what is wrong is named, or that it cannot be told."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stereocal.calibration.corrections import with_pixels
from stereocal.fit.calibrate import calibrate_rig
from stereocal.fit.in_words import rig_notes, rig_sentence
from stereocal.fit.readings.moving_cameras import moving_cameras
from stereocal.fit.readings.noise_left import fewer_points, noise_of
from stereocal.fit.rig_file import RigFile, rig_file
from stereocal.fit.screening.movement import MovedError
from stereocal.formats.dataset_files import read_recording
from stereocal.rig.camera import Camera
from stereocal.rig.recording import Recording
from stereocal.rig.rigid_object import BoardPattern, RigidObject
from stereocal.simulation import rigs
from stereocal.simulation.rigs import IMAGE_SIZE, SimulatedRig, simulated_rig
from stereocal.simulation.simulate import lens_off_by
from stereocal.system.array_types import FloatArray
from stereocal.workflow.pair_of_rig import data_of_pair
from tests.further import further
from tests.refused import refused
from tests.rigs.mistakes import MISTAKES, bumped_from, from_the_right, in_images, upside_down
from tests.rigs.moving_wand import wave_wand
from tests.rigs.several_cameras import sound


def simulated(seed: int, cameras: int = 3) -> SimulatedRig:
    return simulated_rig(np.random.default_rng(seed), cameras, 100 if cameras == 4 else 150)


def mirrored_in_all(recording: Recording) -> Recording:
    """The images of all cameras mirrored, and their files as of lenses that do not tell."""
    cameras = dict[str, Camera]()
    for name, camera in recording.cameras.items():
        K, distortion = camera.K.copy(), camera.distortion.copy()
        K[0, 2] = IMAGE_SIZE[0] - 1.0 - K[0, 2]
        distortion[3:4] *= -1.0
        cameras[name] = replace(camera, K=K, distortion=distortion)
    return replace(with_pixels(recording, cameras, from_the_right), cameras=cameras)


def test_a_sound_rig_of_an_object_whose_ends_are_among_its_points(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    along = np.linspace(0.05, 0.55, 12)
    along[[2, 5]] = 0.0, 0.6
    wand = RigidObject(tuple("abcdefghijkl"), np.outer(along, [1.0, 0.0, 0.0]))
    assert wand.longest == (2, 5)
    monkeypatch.setattr(rigs, "WAND", wand)
    assert calibrate_rig(simulated_rig(np.random.default_rng(1), 3, 60).recording).warnings == ()


@pytest.mark.parametrize(("boards", "seen"), [(7, 0.99), (12, 0.4)])
def test_a_sound_rig_of_few_boards_or_of_hidden_ones(
    boards: int, seen: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nine corners of a board are too few to judge these."""
    board = RigidObject.of_board(BoardPattern(8, 6, 0.08))

    def placed(rng: np.random.Generator, frames: int) -> FloatArray:
        turns = Rotation.from_rotvec(rng.normal(0.0, 0.35, (frames, 3))).as_matrix()
        middle = rng.uniform([-1.0, -0.7, -1.0], [1.0, 0.7, 1.0], (frames, 1, 3))
        flat = board.points - board.points.mean(axis=0)
        return np.asarray(flat @ turns.transpose(0, 2, 1) + middle)

    for name, value in {"WAND": board, "_placed": placed, "NEAR": seen, "FAR": seen}.items():
        monkeypatch.setattr(rigs, name, value)
    recording = simulated_rig(np.random.default_rng(boards), 3, boards).recording
    assert calibrate_rig(recording).warnings == ()
    assert np.isfinite(noise_of(fewer_points(recording)).px)


def test_a_sound_chain_is_not_accused_because_a_camera_shares_too_few_bars() -> None:
    chain = simulated_rig(np.random.default_rng(6), 9, 200, neighbours_only=True)
    assert {*calibrate_rig(chain.recording).unreached} == {"c1", "c2", "c3"}


@pytest.mark.parametrize(
    ("kind", "mistake", "said"),
    [
        ("3 cameras, waved wand", "a crop", ["camera c3", "(645, 496) px"]),
        ("3 cameras", "the same points in two cameras", ["c1 and c2", "points", "frame 1"]),
        ("3 cameras", "one file for all cameras", ["c1 and c2 and c3", "1299 px"]),
        ("3 cameras, waved wand", "a frame lost half-way", ["frame 76", "camera c3", "1 frame"]),
        *further(
            ("3 cameras", "camera files exchanged", ["files of c1 and c2", "0.43 px"]),
            ("3 cameras", "K of half the image", ["camera c1", "K ", "1280x1024 px"]),
            ("3 cameras", "targets exchanged in one camera", ["A and B", "camera c1"]),
            ("3 cameras", "one frame less", ["frames of camera c1", " 1 "]),
            ("3 cameras", "bar in cm", ["c1 and c2", "60 m", "centimetres"]),
        ),
    ],
)
def test_a_wrong_input_is_refused_and_its_camera_named(
    kind: str, mistake: str, said: list[str]
) -> None:
    """All kinds, 6 kinds of rig: `python -m benchmarks.mistakes wrong --kind rigs`.

    Readings that a pair has too are judged as there (tests/calibration/test_wrong_inputs.py).
    """
    with refused(*said):
        calibrate_rig(MISTAKES[mistake].of_rig(kind, 0))


def test_cameras_that_sway_are_told() -> None:
    """By 0.3 degrees in each frame; all errors are stated, as of 5 px of noise."""
    (warning,) = calibrate_rig(
        MISTAKES["cameras that sway in every frame"].of_rig("3 cameras", 0)
    ).warnings
    assert warning.startswith("The cameras seem to move") and "in every frame" in warning


def test_points_that_scatter_are_no_swaying_cameras() -> None:
    """0 of 60 such recordings, with 1, 3 and 8 px, and of a real one with up to 10 px."""
    sound = simulated_rig(np.random.default_rng(3), 3, 60).recording
    noise = 5.0 * np.random.default_rng(4).standard_normal(sound.points.shape)
    assert not moving_cameras(in_images(replace(sound, points=sound.points + noise)))


def test_lengths_of_another_unit_are_asked_about() -> None:
    (warning,) = calibrate_rig(MISTAKES["object in cm"].of_rig("3 cameras", 0)).warnings
    assert "Are these lengths in metres?" in warning and "if they are in cm" in warning


def test_a_marker_that_is_not_where_it_is_said_to_be_is_told() -> None:
    """Real: the markers are 130.1 mm apart. It was silent, as `calibrate --pair` was not."""
    recording = read_recording("sample_data/rig")
    recording = recording.where(recording.frame < 150)
    held = recording.object
    points = held.points.copy()
    points[held.names.index("M")] = [0.26, 0.0, 0.0]
    wrong = replace(recording, object=replace(held, points=points))
    (warning,) = calibrate_rig(wrong).warnings
    assert all(figure in warning for figure in ("A-M 130.", "stated 260.0", "M-B 2"))
    assert calibrate_rig(recording).warnings == ()


def test_a_camera_on_its_head_is_said() -> None:
    """Its points tell it only where the centre of its lens is far from that of its images. Cameras
    that look down by 27 to 42 degrees, as recorded and with one turned by half a turn."""
    recording = read_recording("sample_data/rig")
    recording = recording.where(recording.frame < 150)
    turned = with_pixels(recording, ["3"], upside_down)
    assert calibrate_rig(recording).warnings == ()
    (warning,) = calibrate_rig(turned).warnings
    assert "Camera 3 stands on its head beside the others" in warning


def test_the_side_is_said_where_nothing_tells_mirrored_images() -> None:
    """Bars look alike in a mirror, and so do lenses whose centres are in the middle; boards do not:
    their corners run the other way round."""
    truth = simulated(1)
    places = {name: pose.inverse().T[0] for name, pose in truth.poses.items()}
    farthest = max(places.values(), key=abs)
    mirrored = mirrored_in_all(truth.recording)
    for recording, turn in ((truth.recording, 1.0), (mirrored, -1.0)):
        rig = calibrate_rig(recording)
        assert rig.warnings == ()
        side = "right" if turn * farthest > 0.0 else "left"
        assert f"on the {side} of camera c1" in rig_sentence(rig_file(rig))
    board = calibrate_rig(sound("3 cameras, board", 3)[0].recording)
    assert "of c1, as c1 sees it" not in rig_sentence(rig_file(board))


def test_a_lens_is_contradicted_by_what_contradicts() -> None:
    """Its centre, 78 px off, and not its focal length, which the fit hardly moves."""
    recording = sound("3 cameras", 1)[0].recording
    camera = recording.cameras["c2"]
    away = lens_off_by(camera, 0.0, (60.0, -50.0))
    found = calibrate_rig(replace(recording, cameras={**recording.cameras, "c2": away}))
    (warning,) = [each for each in found.warnings if "lens of camera c2" in each]
    assert "its centre would be" in warning and "focal length" not in warning


def test_seven_boards_of_many_corners_connect_a_camera() -> None:
    """Some of them are seen in part, without the corners that are farthest apart."""
    truth = sound("3 cameras, board", 2)[0]
    recording = truth.recording
    frames = np.unique(recording.frame[recording.camera == 2])[:7]
    few = (recording.camera != 2) | np.isin(recording.frame, frames)
    few &= (recording.camera != 2) | (recording.target > 0) | (recording.frame > frames[3])
    rig = calibrate_rig(recording.where(np.asarray(few)))
    assert not rig.unreached
    turn = Rotation.from_matrix(rig.poses["c3"].R @ truth.poses["c3"].R.T).magnitude()
    assert np.degrees(turn) < 0.4  # 0.24, of a lens that seven boards know to 5 px


def test_a_measured_baseline_that_the_rig_leaves_is_said() -> None:
    """2 % too long, stated to 1 %; the objects fix the scale better."""
    truth = simulated(1)
    true = (truth.poses["c2"] @ truth.poses["c1"].inverse()).baseline
    long = replace(truth.recording, baselines_m={("c1", "c2"): 1.02 * true})
    (warning,) = calibrate_rig(replace(long, baseline_sigma_m=0.01 * true)).warnings
    assert warning.startswith("The baseline c1-c2 is ") and "its stated uncertainty" in warning


@pytest.mark.parametrize("degrees", [0.05, *further(0.2)])
def test_a_bumped_camera_is_named(degrees: float) -> None:
    truth = simulated(1)
    rig = calibrate_rig(bumped_from(truth, "c2", degrees, 80))
    (warning,) = rig.warnings
    assert "Camera c2 seems to have moved at about frame" in warning
    when = int(warning.split("frame ")[1].split(",")[0])
    assert abs(when - 80) < 15


def test_frames_of_a_waved_wand_count_for_less_where_lenses_are_off() -> None:
    """The autocorrelation of the residuals alone does not show it: the design effect was 1."""
    _, recording = wave_wand(1, np.zeros(4), 150, misfit_px=0.2)
    rig = calibrate_rig(recording, late=False)
    assert not rig.clusters.has_runs
    assert rig.design_effect > 1.5


@pytest.mark.parametrize(("seed", "frames", "misfit_px"), [(18, 100, 0.4), (6, 120, 0.3)])
def test_lenses_that_are_not_as_their_model_make_no_movement_and_no_offsets(
    seed: int, frames: int, misfit_px: float
) -> None:
    rig = calibrate_rig(wave_wand(seed, np.zeros(3), frames, misfit_px=misfit_px)[1])
    assert rig.warnings == () and not rig.time_offsets.any()


@pytest.mark.parametrize("degrees", [0.2, *further(2.0)])
def test_of_two_cameras_it_cannot_be_told_which_was_bumped(degrees: float) -> None:
    recording = bumped_from(simulated(1), "c2", degrees, 80)
    with refused("frame 80", "c1 or c2"):
        calibrate_rig(recording.of_cameras(["c1", "c2"]))


@pytest.mark.parametrize(
    ("rig", "name", "degrees"),
    [
        (lambda: sound("3 cameras", 7501)[0], "c1", 0.5),
        *further(
            (lambda: sound("5 cameras, waved bar", 7500)[0], "c2", 2.0),
            (lambda: simulated(3, 4), "c2", 2.0),
        ),
    ],
)
def test_a_camera_whose_frames_contradict_the_others_since_one_is_refused(
    rig: Callable[[], SimulatedRig], name: str, degrees: float
) -> None:
    """Its images since then were left out one by one, and files were written; the last agrees with
    none of the others, but its frames before and after do."""
    with refused(f"Camera {name} ", "frame 61", by=MovedError):
        calibrate_rig(bumped_from(rig(), name, degrees, 61))


@pytest.mark.parametrize(
    ("seed", "camera", "px"), [(101, 1, (6.0, 3.0)), *further((102, 2, (15.0, -10.0)))]
)
def test_a_camera_that_moved_has_no_wrong_distortion(
    seed: int, camera: int, px: tuple[float, float]
) -> None:
    """Its lens with the other sign fits better than as it was given, and worse than two cameras."""
    recording = simulated_rig(np.random.default_rng(seed), 3, 60).recording
    points = recording.points.copy()
    points[(recording.camera == camera) & (recording.frame >= 30)] += px
    with refused(f"Camera c{camera + 1} ", "frame 30", by=MovedError):
        calibrate_rig(replace(recording, points=points))


def test_cameras_that_face_each_other() -> None:
    truth = simulated_rig(np.random.default_rng(4), 3, 150, arc_deg=180.0)
    rig = calibrate_rig(truth.recording)
    assert not rig.unreached
    for name, pose in truth.poses.items():
        turn = Rotation.from_matrix(rig.poses[name].R @ pose.R.T).magnitude()
        assert np.degrees(turn) < 0.5


@pytest.mark.soak  # below, with a drift
@pytest.mark.parametrize("asked", [None, True])
def test_cameras_out_of_step_have_their_offsets(asked: bool | None) -> None:
    late = np.array([0.0, 0.3, -0.2])
    _, recording = wave_wand(6, late, 120)
    rig = calibrate_rig(recording, late=asked)
    errors = rig_file(rig).standard_errors
    for name, own, true in zip(rig.names, rig.time_offsets, late, strict=True):
        assert own == pytest.approx(true, abs=0.02)
        if name != "c1":
            assert abs(own - true) < 5 * errors[name]["time_offset"]
    assert rig.fit.sigma_px < 0.25


def test_an_offset_that_drifts_is_followed() -> None:
    late = np.array([0.0, 0.3, -0.2])
    _, recording = wave_wand(6, late, 150, drift=2e-3)
    rig = calibrate_rig(recording)
    assert rig.time_offsets == pytest.approx(late, abs=0.02)
    last = rig.offsets[-1]
    assert abs(last.drift - 2e-3) < 4 * last.drift_sigma < 1e-3
    assert rig.fit.sigma_px < 0.25
    read = RigFile.loads(rig_file(rig).dumps())
    assert read.drifts["c3"].drift == read.shift("c1", "c3").drift == last.drift
    assert read.shift("c1", "c3").drift_sigma == last.drift_sigma > 0
    still = replace(read, time_offsets={**read.time_offsets, "c3": 2e-4})
    assert "drifting by" in rig_notes(read)[-1] and "drifting by" in rig_notes(still)[-1]
    pair = data_of_pair(recording, ("c1", "c3"), read)
    rows = pair.correspondences
    apart = rig.pair("c1", "c3").epipolar_distances(rows.primary, rows.secondary)
    assert np.sqrt(np.mean(np.square(apart))) < 0.3


def test_frames_that_are_counted_apart_are_said_where_they_were_brought_into_step() -> None:
    recording = MISTAKES["one frame less"].of_rig("3 cameras", 7000)
    rig = rig_file(calibrate_rig(recording.where(recording.frame < 60)))
    (note,) = rig_notes(rig)
    assert "c2 counts its frames 1 apart from c1: its frame 0 is of the same moment as" in note
