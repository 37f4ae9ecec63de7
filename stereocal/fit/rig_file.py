"""`rig.json`: the cameras of a rig in one frame, with their errors and what the pairs say."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from stereocal.errors import StereocalError
from stereocal.fit.about_rig import AboutRig, PairOfRig, RigFigures
from stereocal.fit.errors.length_in_metres import BarKnown, p95_of_factor
from stereocal.fit.least_squares.small_steps import lens_places, window_places, window_values
from stereocal.fit.least_squares.stated_windows import PARTS
from stereocal.fit.least_squares.unknowns import length_sigma
from stereocal.fit.least_squares.views import DRIFT, EACH, TIME, TRANSLATION
from stereocal.fit.parameter_file import covariance_entry
from stereocal.fit.rig_calibration import RigCalibration, third_cameras
from stereocal.fit.start.fuse import pair_covariance
from stereocal.fit.start.pairs import pair_name
from stereocal.rig.camera import Camera
from stereocal.rig.geometry import Pose
from stereocal.rig.parameters import PIXEL_ORIGIN, RigParameters
from stereocal.rig.result_file import ResultFile
from stereocal.rig.rig import PlacedCamera, Rig
from stereocal.rig.rigid_object import RigidObject
from stereocal.rig.tracks import MeasuredOffset
from stereocal.rig.volume import Volume
from stereocal.system.array_types import FloatArray, IntArray
from stereocal.system.names import check_camera_names
from stereocal.system.records import of_plain

RIG = "rig.json"
RIG_FORMAT = "stereocal-rig/1"
CONVENTION = "x_camera = R @ x_reference + T"
UNITS = {"T": "m", "K": "px", "covariance": "rad, m, px", "noise_px": "px"}
START = "start_frame"
WINDOW = tuple(f"window_{part}" for part in PARTS)
ROTATION = ("turn_x", "turn_y", "turn_z")


@dataclass(frozen=True, eq=False)
class RigFile(ResultFile):
    """The content of `rig.json`."""

    CALLED, SOURCE = "rig", RIG
    READS: ClassVar[Mapping[str, str]] = {"format": RIG_FORMAT, "convention": CONVENTION}
    INDENT = 1

    cameras: Mapping[str, Camera]
    """By name; the first is the reference."""
    poses: Mapping[str, Pose]
    """`camera_from_reference`."""
    time_offsets: Mapping[str, float]
    """By how many frames each camera is late; whole frames are in `start_frames`."""
    covariance: FloatArray
    """(Q, Q): of the unknowns of `views`."""
    noise_px: float
    about: AboutRig
    volume: Volume | None = None
    """Where the object was, as the reference sees it; None if not in front of it."""
    drifts: Mapping[str, MeasuredOffset] = field(default_factory=dict)
    """Of cameras whose offset changes from frame to frame."""
    start_frames: Mapping[str, int] = field(default_factory=dict)
    """By camera, the frame at which its frame 0 was taken, if the recording counted them apart."""
    others: Mapping[str, Any] = field(default_factory=dict)
    """Entries of a file that this version does not know."""

    def __post_init__(self) -> None:
        check_camera_names(self.cameras)

    @property
    def names(self) -> list[str]:
        return list(self.cameras)

    @cached_property
    def q(self) -> FloatArray:
        """(Q,): the unknowns of `views`; the rotations are in `R`."""
        q = np.zeros(len(self.covariance))
        q[-1] = float(self.about.object.get("factor", 1.0))
        for number, (name, camera) in enumerate(self.cameras.items()):
            q[lens_places(number)] = camera.lens_values
            first = EACH * number
            q[first + TRANSLATION : first + 2 * TRANSLATION] = self.poses[name].T
            q[first + TIME] = self.time_offsets[name]
            if camera.window is not None:
                q[window_places(number, len(self.cameras))] = window_values(camera.window)
        return q

    @property
    def metric_p95(self) -> float | None:
        """95 % of lengths in metres are within this fraction; None if unknown."""
        figures = self.about.figures
        return None if figures is None else figures.metric_error_p95

    @property
    def length_m(self) -> float | None:
        """The longest distance of that object; None if the file does not say."""
        return None if self.object is None else self.object.longest_m

    @property
    def found_by(self) -> dict[str, Any]:
        """What a file that is made with it says of it."""
        return {"method": "refined", "inputs_sha256": None}

    @property
    def object(self) -> RigidObject | None:
        """The object that the rig was calibrated with; None if the file does not say."""
        points = dict(self.about.object)
        points.pop("factor", None)
        return RigidObject(tuple(points), np.array([*points.values()])) if points else None

    @property
    def object_known(self) -> BarKnown | None:
        """How well the object's lengths are known; None if the file does not say."""
        figures, held = self.about.figures, self.object
        if held is None or figures is None or figures.object_sigma is None:
            return None
        stated = figures.object_sigma * held.longest_m if figures.object_sigma_stated else None
        p95 = p95_of_factor(self.q[-1], self.covariance[-1, -1])
        return BarKnown.of(held.word, held.longest_m, stated, p95)

    @property
    def placed(self) -> dict[str, PlacedCamera]:
        """The cameras and their poses by name."""
        return {name: PlacedCamera(lens, self.poses[name]) for name, lens in self.cameras.items()}

    @property
    def R(self) -> FloatArray:
        """(c, 3, 3)."""
        return np.array([pose.R for pose in self.poses.values()])

    def pair(self, first: str, second: str) -> RigParameters:
        """The refined parameters of two cameras."""
        pose = self.poses[second] @ self.poses[first].inverse()
        rig = Rig(self.cameras[first], self.cameras[second], pose)
        a, b = self.names.index(first), self.names.index(second)
        covariance = pair_covariance(a, b, self.q, self.R, self.covariance)
        figures, stated = self.about.figures, self.object
        offset = self.shift(first, second)
        return RigParameters(
            rig.primary,
            rig.secondary,
            pose,
            method="refined",
            cost=0.0,
            settings={"rig": self.names},
            inputs={} if stated is None else {"target_distance_m": stated.longest_m},
            matching_threshold_px=2.0 * self.noise_px,
            uncertainties={
                "sigma_px": {
                    "value": self.noise_px,
                    "degrees_of_freedom": max(3 * figures.independent_frames, 1) if figures else 1,
                },
                "covariance": covariance_entry(covariance, rig),
                "bar_length_m": {"estimate": self.q[-1], "stated": 1.0},
                "bar_scatter_m": {"value": figures.length_scatter_m if figures else 0.0},
                "design_effect": figures.design_effect if figures else 1.0,
            },
            noise_px=self.noise_px,
            volume=self.volume,
            time_offset=replace(offset, sigma=float(np.sqrt(covariance[EACH + TIME, EACH + TIME])))
            if offset.is_shift
            else None,
            camera_names=(first, second),
            start_frame=self.start_frames.get(second, 0) - self.start_frames.get(first, 0),
        )

    def shift(self, first: str, second: str) -> MeasuredOffset:
        """How late the second camera is after the first, without the error of that."""
        one, other = (self.drifts.get(name, MeasuredOffset()) for name in (first, second))
        return MeasuredOffset(
            self.time_offsets[second] - self.time_offsets[first],
            other.drift - one.drift,
            next((drift.reference for drift in self.drifts.values()), 0.0),
            drift_sigma=math.hypot(one.drift_sigma, other.drift_sigma),
        )

    @cached_property
    def standard_errors(self) -> dict[str, dict[str, float]]:
        """The standard errors of the unknowns of each camera, by name."""
        errors = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        count, every = len(self.cameras), dict[str, dict[str, float]]()
        for number, (name, camera) in enumerate(self.cameras.items()):
            of_camera = errors[EACH * number : EACH * (number + 1)].tolist()
            every[name] = dict(zip(_unknowns(camera), of_camera, strict=False))
            if camera.window is not None:
                of_window = errors[window_places(number, count)].tolist()
                every[name] |= dict(zip(WINDOW, of_window, strict=True))
        return every

    def content(self) -> dict[str, Any]:
        cameras = {
            name: {
                **placed.to_json(),
                **(self.drifts[name].to_json() if name in self.drifts else {}),
                "time_offset_frames": self.time_offsets[name],
                **({START: self.start_frames[name]} if any(self.start_frames.values()) else {}),
                "standard_errors": self.standard_errors[name],
            }
            for name, placed in self.placed.items()
        }
        of = [f"{name} {key}" for name, lens in self.cameras.items() for key in _unknowns(lens)]
        return {
            "format": RIG_FORMAT,
            "convention": CONVENTION,
            "units": UNITS,
            "pixel_origin": PIXEL_ORIGIN,
            "reference": self.names[0],
            "cameras": cameras,
            "noise_px": self.noise_px,
            "volume": None if self.volume is None else self.volume.to_json(),
            **self.about.to_json(),
            **self.others,
            "covariance": self.covariance[_written(self.cameras)].tolist(),
            "covariance_of": [*of, *_of_windows(self.cameras), "object_factor"],
        }

    @classmethod
    def _of_content(cls, data: Mapping[str, Any]) -> "RigFile":
        cameras = {
            name: Camera.from_json(lens, f"camera {name}") for name, lens in data["cameras"].items()
        }
        stored = np.array(data["covariance"], dtype=np.float64)
        written = _written(cameras)
        size = EACH * len(cameras) + len(_of_windows(cameras)) + 1
        if len(cameras) < 2 or stored.shape != (len(written[0]),) * 2:
            raise StereocalError("the cameras and the covariance do not belong together.")
        covariance = np.zeros((size, size))
        covariance[written] = stored
        if not np.isfinite(stored).all():
            raise StereocalError("the covariance has a number that is not finite.")
        volume, entries = data.get("volume"), of_plain(data, AboutRig)
        # A ValueError for a number that is not finite.
        json.dumps(entries.to_json(), allow_nan=False)
        if entries.figures and entries.figures.weakest_camera not in cameras:
            raise ValueError("the weakest camera")
        late = {name: float(entry["time_offset_frames"]) for name, entry in data["cameras"].items()}
        drifts = dict[str, MeasuredOffset]()
        for name, entry in data["cameras"].items():
            offset = {"value": late[name], "standard_error": 0.0}
            drift = MeasuredOffset.from_json({**entry, "time_offset_frames": offset})
            if drift is not None and "time_drift" in entry:
                drifts[name] = drift
        starts, late = counts_and_shutters(late, covariance)  # whole frames are of older files
        starts = {name: int(data["cameras"][name].get(START, starts[name])) for name in cameras}
        read = cls(
            cameras,
            {name: Pose.from_json(entry) for name, entry in data["cameras"].items()},
            late,
            covariance,
            float(data["noise_px"]),
            entries,
            None if volume is None else Volume.from_json(volume),
            drifts,
            starts if any(starts.values()) else {},
        )
        known = read.to_json()
        return replace(read, others={name: data[name] for name in data if name not in known})


def _unknowns(camera: Camera) -> tuple[str, ...]:
    """Names of the unknowns of a camera that the file has."""
    return (*ROTATION, "x", "y", "z", *camera.lens_names, "time_offset")


def _of_windows(cameras: Mapping[str, Camera]) -> list[str]:
    """The names of the unknowns of their windows; empty if no camera looks through one."""
    through = any(camera.window is not None for camera in cameras.values())
    return [f"{name} {key}" for name in cameras for key in WINDOW] if through else []


def _written(cameras: Mapping[str, Camera]) -> tuple[IntArray, IntArray]:
    """Where the file's covariance is in that of all unknowns of `views`: a rig has no drifts."""
    of_cameras = EACH * len(cameras)
    places = np.arange(of_cameras + len(_of_windows(cameras)) + 1)
    return np.ix_(*2 * [places[(places % EACH != DRIFT) | (places >= of_cameras)]])


Parameters = RigParameters | RigFile


def read_parameters(content: bytes, label: str) -> Parameters:
    """What a file holds: a rig, or a parameter set of two cameras; `label` is for messages."""
    return (RigFile if is_rig(content) else RigParameters).loads(content, label)


def is_rig(content: bytes) -> bool:
    """Whether the content of a file is a rig's, of any version."""
    return b'"stereocal-rig/' in content[:200]


def holds_rig(path: Path) -> bool:
    """Whether a file is a rig's, of any version."""
    try:
        with path.open("rb") as file:
            return is_rig(file.read(200))
    except OSError:
        return False


def rig_file(rig: RigCalibration) -> RigFile:
    """The file of a calibrated rig."""
    points = rig.point_fits[0][~rig.fit.outlying[rig.fit.frame_of]].reshape(-1, 3)
    points = points[np.isfinite(points[:, 0])]
    held = rig.recording.object
    places = dict(zip(held.names, held.points.tolist(), strict=True))
    late = dict(zip(rig.names, rig.time_offsets.tolist(), strict=True))
    entries = AboutRig(
        inputs={"name": rig.recording.name, "sha256": rig.sha256},
        object={**places, "factor": float(rig.fit.q[-1])},
        figures=_figures_of(rig),
        image_errors_px={
            name: px if np.isfinite(px) else None for name, px in rig.image_px.items()
        },
        frames_left_out=rig.left_out,
        wrong_images=rig.wrong,
        loops=rig.loops,
        third_camera_px=third_cameras(rig),
        pairs={
            pair_name(pair): PairOfRig(
                pair,
                bars,
                failed=rig.pairs.failed.get(pair),
                frames=getattr(rig.pairs.fits.get(pair), "frames", None),
                noise_px=getattr(rig.pairs.fits.get(pair), "noise_px", None),
            )
            for pair, bars in rig.pairs.bars.items()
        },
        not_connected=rig.unreached,
        warnings=rig.warnings,
    )
    wholes, late = counts_and_shutters(late, rig.covariance)
    starts = {name: wholes[name] + rig.recording.start_frames.get(name, 0) for name in rig.names}
    sighted = points[:, 2].min() > 0 if len(points) else False
    return RigFile(
        rig.cameras,
        rig.poses,
        late,
        rig.covariance,
        float(rig.fit.sigma_px),
        entries,
        Volume.of_bars(points) if sighted else None,
        {name: offset for name, offset in zip(rig.names, rig.offsets, strict=True) if offset.drift},
        starts if any(starts.values()) else {},
    )


def _figures_of(rig: RigCalibration) -> RigFigures:
    fit, settings = rig.fit, rig.fit.settings
    known = len(rig.length_errors) > 0
    figures = RigFigures(
        reprojection_px=float(np.sqrt(np.nanmean(np.square(rig.reprojection_px)))),
        length_error_p95=float(np.quantile(np.abs(rig.length_errors), 0.95)) if known else None,
        frames=len(fit.used),
        independent_frames=rig.clusters.count,
        design_effect=rig.design_effect,
        length_scatter_m=fit.scatter,
        weakest_camera=rig.weakest,
        held_out={name: measured.errors for name, measured in rig.held_out.items()},
    )
    scatter = figures.to_expect.length_error_p95
    if scatter is None:
        return figures
    of_object = p95_of_factor(float(fit.q[-1]), rig.covariance[-1, -1])
    sigma, is_stated = length_sigma(rig.recording, settings)
    return replace(
        figures,
        metric_error_p95=math.hypot(scatter, of_object),
        object_sigma=sigma,
        object_sigma_stated=is_stated,
    )


def counts_and_shutters(
    offsets: Mapping[str, float], covariance: FloatArray
) -> tuple[dict[str, int], dict[str, float]]:
    """The whole frames of the time offset of each camera, and what is left (`split`)."""
    sigmas = np.sqrt(np.maximum(np.diag(covariance)[TIME : EACH * len(offsets) : EACH], 0.0))
    parts = {
        name: MeasuredOffset(frames, sigma=float(sigma)).split()
        for (name, frames), sigma in zip(offsets.items(), sigmas, strict=True)
    }
    wholes = {name: whole for name, (whole, _) in parts.items()}
    return wholes, {name: rest.frames for name, (_, rest) in parts.items()}
