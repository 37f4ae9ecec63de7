"""Rigs of three cameras and more: are the stated errors true, and what do others make of them?

    python -m benchmarks.rigs [truth|still|halves|size|real|time] [--rigs N] [--cameras 3]

- truth: root mean square of the errors of poses over the stated ones, of simulated rigs;
- still: wands waved before 3 to 5 cameras whose lenses are off by 0.1 to 0.4 px in ways that no
  model contains: how many rigs say that a camera moved, as they are, and with one turned by 0.2
  degrees;
- halves: differences of both halves in time of such rigs over their stated errors, and what each
  states of its images over what the other half shows;
- size: seconds of 4 cameras with 400 frames, and of 9 with 450;
- real: eWand's cameras 1, 2, 3 (STEREOCAL_REAL_DATA), beside SciPy and, in the venv of
  `benchmarks.peers`, aniposelib and Caliscope;
- time: the same recording cut in time: one part fitted, the other tested.

Time against SciPy: `benchmarks.speed refine`.
"""

import contextlib
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.peers.scipy_joint import Known, joint
from benchmarks.studies import Asked, real_data, rms, run_studies, spread
from stereocal.errors import StereocalError
from stereocal.fit.about_rig import AboutRig
from stereocal.fit.calibrate import calibrate_rig
from stereocal.fit.least_squares.observations import Observations
from stereocal.fit.least_squares.robust import RobustFit
from stereocal.fit.least_squares.small_steps import lens_places
from stereocal.fit.least_squares.unknowns import DEFAULT_DISTANCE, LensPrior, RefineSettings
from stereocal.fit.least_squares.views import EACH
from stereocal.fit.rig_calibration import RigCalibration, third_cameras
from stereocal.fit.rig_file import RigFile, rig_file
from stereocal.fit.start.fuse import Fused, fuse
from stereocal.formats.dataset_files import read_recording
from stereocal.matching.view_groups import ViewFitter
from stereocal.rig.camera import Camera
from stereocal.rig.geometry import Pose
from stereocal.rig.recording import Recording
from stereocal.simulation.rigs import LENS_ERRORS, SimulatedRig, simulated_rig
from stereocal.system.array_types import FloatArray
from tests.rigs.mistakes import bumped_from
from tests.rigs.moving_wand import stated_over_true, wave_wand

LENS = LensPrior(*LENS_ERRORS)
OF_POSE = 6
FREE = LensPrior(0.05, 50.0)


def settings(truth: SimulatedRig) -> RefineSettings:
    """What is stated: the lenses to their errors."""
    return RefineSettings(lenses=dict.fromkeys(truth.cameras, LENS))


def truth(asked: Asked) -> None:
    """Errors over stated errors."""
    z = []
    for seed in asked.numbers:
        scene = simulated_rig(np.random.default_rng(seed), asked.cameras, asked.frames)
        rig = calibrate_rig(scene.recording, settings(scene))
        sigma = np.sqrt(np.diag(rig.covariance))
        for number, name in enumerate(rig.names[1:], 1):
            own = _between(rig.poses[name], scene.poses[name])
            z.append(own / sigma[EACH * number : EACH * number + OF_POSE])
    print(f"  {asked.cameras} cameras, {asked.frames} frames: rms of z of the poses {rms(z):.3f}")


def misfitted(
    number: int, salt: int, frames: int = 0
) -> tuple[SimulatedRig, Recording, np.random.Generator]:
    """A wand waved before 3 to 5 cameras, lenses off by 0.1 to 0.4 px, and more randomness."""
    rng = np.random.default_rng([number, salt])
    late, misfit = np.zeros(int(rng.choice([3, 4, 5]))), float(rng.choice([0.1, 0.2, 0.4]))
    frames = frames or int(rng.choice([100, 200, 300]))
    return *wave_wand(number, late, frames, misfit), rng


def still(asked: Asked) -> None:
    """How many rigs say that a camera moved."""
    moved = Counter[str]()
    for number in asked.numbers:
        truth, recording, rng = misfitted(number, 3)
        name = f"c{rng.integers(len(recording.cameras)) + 1}"
        frames = np.unique(recording.frame)
        at = int(frames[int(len(frames) * rng.uniform(0.3, 0.7))])
        turned = bumped_from(replace(truth, recording=recording), name, 0.2, at)
        for what, each in (("still", recording), ("turned", turned)):
            warnings = calibrate_rig(each, late=False).warnings
            moved[what] += any("moved" in warning for warning in warnings)
    print(f"  moved of {asked.trials}: still {moved['still']}, turned {moved['turned']}")


def halves(asked: Asked) -> None:
    """The rms of the differences of halves over their stated errors, and stated over true errors in
    images."""
    poses, lenses, images = list[float](), list[float](), list[float]()
    for number in asked.numbers:
        recording = misfitted(number, 4, 300)[1]
        cut = np.array_split(np.unique(recording.frame), 2)
        one, other = (recording.where(np.isin(recording.frame, half)) for half in cut)
        free = RefineSettings(dict.fromkeys(recording.cameras, FREE), baseline_sigma_m=np.inf)
        both = [calibrate_rig(part, free, late=False) for part in (one, other)]
        images += stated_over_true(both[0], other) + stated_over_true(both[1], one)
        if both[0].names == both[1].names:
            found = differences(*both)
            poses += found[0]
            lenses += found[1]
    print(f"  rms of poses {rms(poses):.2f}, of lenses {rms(lenses):.2f} stated errors")
    print(f"  images, stated over true: {spread(images)} of {len(images)} cameras")


def differences(one: RigCalibration, other: RigCalibration) -> tuple[list[float], list[float]]:
    """Of the poses and of the lenses, over the stated errors."""
    variances, q = np.diag(one.covariance + other.covariance), one.fit.q - other.fit.q
    poses, lenses = list[float](), list[float]()
    for number, name in enumerate(one.names):
        places = [place for place in lens_places(number) if variances[place] > 0.0]
        lenses += (q[places] / np.sqrt(variances[places])).tolist()
        if number:
            own = variances[EACH * number : EACH * number + OF_POSE]
            poses += (_between(one.poses[name], other.poses[name]) / np.sqrt(own)).tolist()
    return poses, lenses


def against_scipy(numbers: range, cameras: int, frames: int) -> None:
    """Held-out px and seconds, ours and SciPy's, from the same start."""
    ratios, faster, spent = [], [], []
    for seed in numbers:
        scene = simulated_rig(np.random.default_rng(seed), cameras, 2 * frames)
        fitted = scene.recording.where(scene.recording.frame % 2 == 0)
        try:
            rig = calibrate_rig(fitted, settings(scene))
        except StereocalError:  # two cameras that share too few frames
            continue
        if rig.unreached:
            continue
        for _ in range(2):  # the first one compiles
            began = time.process_time()
            fused = fused_pairs(rig, settings(scene))
            fit = RobustFit.of(rig.recording, fused.poses, settings(scene))
            fit.start_at(fused.unknowns.named(fused.p), rig.fit.sigma_px)
            fit.run()
            ours_s = time.process_time() - began
        began = time.process_time()
        poses, lenses = by_scipy(rig)
        faster.append((time.process_time() - began) / ours_s)
        spent.append(1e3 * ours_s)
        ours = held_out(scene, list(rig.poses.values()), list(rig.cameras.values()))
        ratios.append(ours / held_out(scene, poses, lenses))
    print(
        f"  {cameras} cameras, {frames} frames: px over SciPy's {np.mean(ratios):.4f}, at most "
        f"{max(ratios):.4f}; ours {spread(spent, 80)} ms of CPU, SciPy takes {spread(faster, 80)} "
        "times as long",
        flush=True,
    )


def fused_pairs(rig: RigCalibration, settings: RefineSettings | None = None) -> Fused:
    """The pairs of a rig fused, from where its joint fit began."""
    return fuse(rig.recording, list(rig.pairs.fits.values()), settings or RefineSettings())


def by_scipy(rig: RigCalibration, lens: LensPrior = LENS) -> tuple[list[Pose], list[Camera]]:
    """One `least_squares` over the same unknowns, with the same priors."""
    known = Known(
        rig.fit.sigma_px, rig.fit.scatter, lens.focal, lens.centre_px, factor=DEFAULT_DISTANCE
    )
    return joint(rig.recording, fused_pairs(rig).poses, rig.point_fits[0], known, "linear")


def held_out(scene: SimulatedRig, poses: Sequence[Pose], lenses: Sequence[Camera]) -> float:
    """Root mean square distance of the images of the odd frames, px."""
    names = list(scene.cameras)
    own = Observations.of(scene.recording.where(scene.recording.frame % 2 == 1))
    pixels = own.pixels.reshape(-1, len(names), 2)
    pixels = pixels[np.isfinite(pixels[..., 0]).sum(axis=1) > 1]
    fitter = _fitter(dict(zip(names, lenses, strict=True)), dict(zip(names, poses, strict=True)))
    found = fitter.fit(pixels, fitter.rays(pixels))
    return float(np.sqrt(found.chi_square.sum() / np.isfinite(pixels[..., 0]).sum()))


def three() -> Recording:
    """eWand's three cameras, without measured baselines."""
    return replace(read_recording(real_data() / "ewand123"), baselines_m={})


def real(_: Asked) -> None:
    """A recording of three cameras: even frames fitted, odd ones tested, by all programs."""
    recording = three()
    even, odd = (recording.where(recording.frame % 2 == k) for k in (0, 1))
    calibrate_rig(even)  # compiles
    began = time.perf_counter()
    rig = calibrate_rig(even)
    ours_s = time.perf_counter() - began
    stated = dict(recording.cameras)
    fused = dict(zip(rig.names, fused_pairs(rig).poses, strict=True))
    _tested("stereocal", odd, rig.cameras, rig.poses, ours_s)
    ends = even.where(even.target != 1)
    without = calibrate_rig(ends)
    _tested("stereocal, without the middle marker", odd, without.cameras, without.poses, 0.0)
    began = time.perf_counter()
    poses, lenses = by_scipy(rig, LensPrior())
    _tested(
        "SciPy, from the fused pairs",
        odd,
        dict(zip(rig.names, lenses, strict=True)),
        dict(zip(rig.names, poses, strict=True)),
        time.perf_counter() - began,
    )
    with contextlib.suppress(ImportError):
        from benchmarks.peers import aniposelib

        for name, cameras in (("stated", stated), ("stereocal's", rig.cameras)):
            began = time.perf_counter()
            own = aniposelib.solve_rig(replace(even, cameras=cameras), list(fused.values()))
            spent = time.perf_counter() - began
            _tested(f"aniposelib, {name} lenses, from the fused pairs", odd, cameras, own, spent)
    with contextlib.suppress(ImportError):
        from benchmarks.peers import caliscope

        for name, cameras in (("stated", stated), ("stereocal's", rig.cameras)):
            began = time.perf_counter()
            found = caliscope.solve_rig(replace(even, cameras=cameras))
            spent = time.perf_counter() - began
            lens = {key: camera for key, (camera, _) in found.items()}
            focal = ", ".join(
                f"{100 * (own.K[0, 0] / cameras[key].K[0, 0] - 1):.2f}" for key, own in lens.items()
            )
            own = {key: pose for key, (_, pose) in found.items()}
            _tested(f"Caliscope, {name} lenses (focal {focal} %)", odd, lens, own, spent)


def cut_in_time(__: Asked) -> None:
    """Halves, and sixteen runs of frames of which every second is fitted, each against the rest."""
    recording = three()
    frames = np.unique(recording.frame)
    for name, runs in (("even frames", len(frames)), ("16 runs", 16), ("halves", 2)):
        part = (np.arange(len(frames)) * runs // len(frames))[
            np.searchsorted(frames, recording.frame)
        ]
        rigs, told = list[RigCalibration](), list[float]()
        for fitted in (0, 1):
            rig = calibrate_rig(recording.where(part % 2 == fitted))
            rest = recording.where(part % 2 != fitted)
            _tested(f"{name}, part {fitted + 1} fitted", rest, rig.cameras, rig.poses, 0.0)
            _, images = rest.images()
            thirds = third_cameras(rig, images.reshape(-1, len(rig.names), 2))
            print(
                "  third camera, median px: "
                + ", ".join(
                    f"{'-'.join(own.pair)} in {own.camera} {own.before:.2f} with pairs, "
                    f"{own.after:.2f}"
                    for own in thirds
                )
            )
            rigs.append(rig)
            told += stated_over_true(rig, rest)
        z, of_lenses = differences(*rigs)
        print(
            f"  poses of the two parts differ by {rms(z):.2f} stated errors (rms of {len(z)}, at "
            f"most {np.abs(np.array(z)).max():.1f}), lenses by {rms(of_lenses):.2f}; design effects"
            f" {', '.join(f'{rig.design_effect:.1f}' for rig in rigs)}; images, stated over true: "
            f"{np.round(told, 2).tolist()}"
        )


def _between(one: Pose, other: Pose) -> FloatArray:
    """(6,): small rotation about the camera's axes, and translation."""
    return np.concatenate([Rotation.from_matrix(one.R @ other.R.T).as_rotvec(), one.T - other.T])


def _tested(
    program: str,
    recording: Recording,
    cameras: Mapping[str, Camera],
    poses: Mapping[str, Pose],
    spent_s: float,
) -> None:
    """Print px of the ends and of the middle marker, and length errors, of the best 98 %."""
    names = list(cameras)
    fitter = _fitter(cameras, poses)
    _, pixels = recording.images()
    pixels = pixels[(np.isfinite(pixels[..., 0]).sum(axis=2) > 2).all(axis=1)]
    flat = pixels.reshape(-1, len(names), 2)
    found = fitter.fit(flat, fitter.rays(flat))
    squares = (found.chi_square / np.isfinite(flat[..., 0]).sum(axis=1)).reshape(pixels.shape[:2])
    points, own = found.xyz.reshape(*pixels.shape[:2], 3), recording.object
    lengths = ", ".join(
        f"{own.names[i]}-{own.names[j]} {100 * _best(np.abs(error)).mean():.3f} %"
        for i, j in combinations(range(len(own.names)), 2)
        for error in [np.linalg.norm(points[:, i] - points[:, j], axis=1) / own.distance(i, j) - 1]
    )
    px, middle = (
        np.sqrt(_best(some.ravel()).mean()) for some in (squares[:, [0, -1]], squares[:, 1])
    )
    print(f"{program}: {px:.3f} px, middle {middle:.3f} px, {lengths}, {spent_s:.2f} s")


def _fitter(cameras: Mapping[str, Camera], poses: Mapping[str, Pose]) -> ViewFitter:
    late, covariance = dict.fromkeys(cameras, 0.0), np.zeros((EACH * len(cameras) + 1,) * 2)
    return ViewFitter(RigFile(cameras, poses, late, covariance, 1.0, AboutRig(pairs={})))


def _best(values: FloatArray) -> FloatArray:
    return np.sort(np.nan_to_num(values, nan=np.inf))[: int(0.98 * len(values))]


def size(_: Asked) -> None:
    """Seconds from points to the content of rig.json."""
    for cameras, frames in ((3, 60), (4, 400), (9, 450)):
        scene = simulated_rig(np.random.default_rng(1), cameras, frames)
        began, used = time.perf_counter(), time.process_time()
        rig_file(calibrate_rig(scene.recording)).dumps()
        print(
            f"{cameras} cameras, {frames} frames: {time.perf_counter() - began:.1f} s, "
            f"{time.process_time() - used:.1f} s of the processor"
        )


STUDIES = {
    "truth": (truth, 12),
    "still": (still, 10),
    "halves": (halves, 10),
    "size": (size, 1),
    "real": (real, 1),
    "time": (cut_in_time, 1),
}


if __name__ == "__main__":
    run_studies(STUDIES, __doc__, cameras=3, frames=100)
