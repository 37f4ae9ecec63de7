"""The parameter file of a rig: reading, writing, checking."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self, TypedDict

import numpy as np

from stereocal.errors import StereocalError, refuse
from stereocal.rig.camera import Camera
from stereocal.rig.geometry import Angles, Pose
from stereocal.rig.pair import Pair
from stereocal.rig.result_file import ResultFile
from stereocal.rig.rig import Rig
from stereocal.rig.tracks import MeasuredOffset
from stereocal.rig.volume import Volume
from stereocal.system.answers import Answer
from stereocal.system.array_types import IntArray
from stereocal.system.names import check_camera_names
from stereocal.system.numbers import count

PARAMETERS_FORMAT = "stereocal-parameters/1"
PURPOSES = {"2d": "matching", "3d": "reconstruction", "refined": "both", "imported": "both"}
PIXEL_ORIGIN = "centre of the top-left pixel is (0, 0); u to the right, v down"
CONVENTION = "x_secondary = R @ x_primary + T"
BASELINE_FOUND = "not measured: found by the refined method from the lengths of the bars"
LARGEST_TEXT = 16_000_000
UNITS = {"T": "m", "baseline_m": "m", "angles": "rad", "K": "px", "matching_threshold_px": "px"}


STARTS = "start_frames"


class Timing(TypedDict):
    """What a parameter set says of the counts and the shutters of its cameras."""

    start_frame: int
    time_offset: MeasuredOffset | None


@dataclass(frozen=True)
class ForecastEntries:
    """The entries of a parameter file on its forecast, as JSON."""

    figures: Mapping[str, Any]
    """Value, low and high of the 95 % interval of each figure."""
    uncertainties: Mapping[str, Any]
    """`sigma_px` and the `covariance` of the file about the truth."""

    def raised(self, shown: Mapping[str, float]) -> "ForecastEntries":
        """With what held-out frames have shown, by figure, where that is worse."""
        figures = dict(self.figures)
        for name, value in shown.items():
            worse = {end: max(figures[name][end], value) for end in ("value", "high")}
            figures[name] = {**figures[name], **worse}
        return replace(self, figures=figures)


@dataclass(frozen=True, eq=False, repr=False)
class RigParameters(Answer, Rig, ResultFile):
    """One parameter set: a rig, the method and settings that produced it, and its purpose.

    The file is self-describing JSON, format `stereocal-parameters/1`.
    """

    CALLED, SOURCE = "parameter file", "parameters"
    READS: ClassVar[Mapping[str, str]] = {"format": PARAMETERS_FORMAT}
    INDENT = 2
    LARGEST = LARGEST_TEXT

    method: str
    """`2d`, `3d` or `refined`; `imported` for parameters that another program found."""
    cost: float | None
    """None for imported parameters."""
    settings: Mapping[str, Any]
    inputs: Mapping[str, Any]
    matching_threshold_px: float | None = None
    validation: Mapping[str, Any] | None = None
    triangulation: str = "midpoint"
    uncertainties: Mapping[str, Any] | None = None
    """Noise and covariance of the set about the truth, of a refined set also standard errors; None,
    and no key in the file, if unknown."""
    predicted: Mapping[str, Any] | None = None
    """What the set will do on frames to come: by figure its value, low and high; errors are
    fractions."""
    recommendation: Mapping[str, Any] | None = None
    """Which file to match and which to measure with; None, and no key in the file, if unknown."""
    frames_left_out: tuple[int, ...] = ()
    """Numbers of the frames that the screening excluded from the calibration."""
    noise_px: float | None = None
    """Standard deviation of an image coordinate, estimated with the calibration; None if
    unknown."""
    volume: Volume | None = None
    """Where the bars of the calibration were; None if unknown."""
    time_offset: MeasuredOffset | None = None
    """How late the secondary camera is, so that its points are shifted in time; None, and no key in
    the file, if it is not known to be. Whole frames are in `start_frame`."""
    start_frame: int = 0
    """The primary's frame at which the secondary's frame 0 was taken, by the counts of the
    recording that was calibrated."""

    camera_names: tuple[str, str] | None = None
    """What the primary and the secondary are called in a recording of more; None, and no key in the
    file, if they have no others."""

    def __post_init__(self) -> None:
        check_camera_names(self.camera_names or ())
        of_image = {"matching threshold": self.matching_threshold_px, "image noise": self.noise_px}
        refuse(
            (
                self.method not in PURPOSES,
                f'The method "{self.method}" of the parameter set is unknown: it must be one of '
                f"{', '.join(PURPOSES)}.",
            ),
            (
                self.triangulation != "midpoint",
                f'The parameters were fitted with the triangulation "{self.triangulation}"; this '
                "version supports only midpoint.",
            ),
            (
                self.method != "imported" and (self.cost is None or not np.isfinite(self.cost)),
                "The cost of the parameter set is not a finite number.",
            ),
            *(
                (not 0 <= value < np.inf, f"The {what} is {value} px: it must be 0 or more.")
                for what, value in of_image.items()
                if value is not None
            ),
        )

    @property
    def answer(self) -> list[str]:
        uses = {"matching": "match", "reconstruction": "measure", "both": "match and to measure"}
        turns = ", ".join(
            f"{name} {np.degrees(angle):.4f}" for name, angle in self.pose.angles._asdict().items()
        )
        limit = self.matching_threshold_px
        return [
            f"{self.set_name}, to {uses[self.purpose]} with: the cameras are "
            f"{self.pose.baseline:.4f} m apart, angles in degrees {turns}."
            + (f" Pairs match below {limit:.3g} px." if limit is not None else ""),
            f"Left out: {count(len(self.frames_left_out), 'frame')}.",
        ]

    def pair(self, _first: str, _second: str) -> Self:
        """Itself, as a rig of more cameras has a set of each pair."""
        return self

    @property
    def metric_p95(self) -> float | None:
        """95 % of lengths in metres are within this fraction; None if unknown."""
        return ((self.predicted or {}).get("p95_metric_error_3d") or {}).get("value")

    @property
    def length_m(self) -> float | None:
        """The length of the calibration's bar, or an object's longest distance; None if unknown."""
        stated = self.inputs.get("target_distance_m")
        return stated if isinstance(stated, float) else None

    @property
    def found_by(self) -> dict[str, Any]:
        """What a file that is made with it says of it."""
        return {"method": self.method, "inputs_sha256": self.inputs.get("sha256")}

    @property
    def is_repaired(self) -> bool:
        """Whether a check has repaired them after a movement."""
        return "repaired_from" in self.inputs

    @property
    def set_name(self) -> str:
        """In sentences, such as `2D set`."""
        short = {"2d": "2D", "3d": "3D"}
        return f"{'repaired' if self.is_repaired else short.get(self.method, self.method)} set"

    @property
    def purpose(self) -> str:
        """`matching` for the 2D set, `reconstruction` for the 3D set, else `both`."""
        return PURPOSES[self.method]

    def content(self) -> dict[str, Any]:
        return {
            "format": PARAMETERS_FORMAT,
            "purpose": self.purpose,
            "method": self.method,
            "convention": CONVENTION,
            "units": UNITS,
            "pixel_origin": PIXEL_ORIGIN,
            "cameras": {"primary": self.primary.to_json(), "secondary": self.secondary.to_json()},
            **({} if self.camera_names is None else {"camera_names": list(self.camera_names)}),
            **self.pose.to_json(),
            "E": self.pose.essential.tolist(),
            "angles": self.pose.angles._asdict(),
            "baseline_m": self.pose.baseline,
            "triangulation": self.triangulation,
            "matching_threshold_px": self.matching_threshold_px,
            "cost": self.cost,
            "validation": self.validation,
            **{
                name: dict(value)
                for name in ("predicted", "recommendation", "uncertainties")
                if (value := getattr(self, name)) is not None
            },
            "settings": dict(self.settings),
            "inputs": dict(self.inputs),
            "frames_left_out": list(self.frames_left_out),
            "noise_px": self.noise_px,
            "volume": None if self.volume is None else self.volume.to_json(),
            **({} if self.time_offset is None else self.time_offset.to_json()),
            **({STARTS: {"primary": 0, "secondary": self.start_frame}} if self.start_frame else {}),
        }

    @classmethod
    def _of_content(cls, data: Mapping[str, Any]) -> "RigParameters":
        convention = data["convention"]
        refuse(
            (
                convention != CONVENTION,
                f'the convention {convention!r} is unknown; this version reads "{CONVENTION}".',
            )
        )
        pose = Pose.from_json(data)
        stated = Pose.from_angles(Angles(**data["angles"]), pose.baseline)
        refuse(
            (  # "not <=" rejects NaN too.
                not abs(pose.baseline - float(data["baseline_m"])) <= 1e-6 * pose.baseline,
                "the length of T and baseline_m contradict each other.",
            ),
            (
                not np.allclose(stated.R, pose.R, atol=1e-6)
                or not np.allclose(stated.T, pose.T, 1e-6),
                "the angles and R, T contradict each other.",
            ),
        )
        objects = {name: _object(data[name], name) for name in ("settings", "inputs")}
        for name in ("validation", "uncertainties", "predicted", "recommendation"):
            objects[name] = None if data.get(name) is None else _object(data[name], name)
        volume, named = data.get("volume"), data.get("camera_names")
        # Older files have whole frames in the time offset.
        when = timing(0, MeasuredOffset.from_json(data))
        if STARTS in data:
            starts = data[STARTS]
            when["start_frame"] = int(starts["secondary"]) - int(starts["primary"])
        threshold, noise = data["matching_threshold_px"], data.get("noise_px")
        return cls(
            Camera.from_json(data["cameras"]["primary"], "primary"),
            Camera.from_json(data["cameras"]["secondary"], "secondary"),
            pose,
            method=data["method"],
            cost=None if data["method"] == "imported" else float(data["cost"]),
            matching_threshold_px=threshold if threshold is None else float(threshold),
            triangulation=data["triangulation"],
            frames_left_out=tuple(int(frame) for frame in data.get("frames_left_out", [])),
            noise_px=noise if noise is None else float(noise),
            volume=None if volume is None else Volume.from_json(volume),
            **when,
            camera_names=None if named is None else (str(named[0]), str(named[1])),
            **objects,
        )


def timing(start_frame: int, offset: MeasuredOffset | None) -> Timing:
    """The entries of a parameter set on time.

    Args:
        start_frame: of the data set.
        offset: by which its secondary points were shifted.
    """
    if offset is None:
        return {"start_frame": start_frame, "time_offset": None}
    whole, rest = offset.split()
    return {"start_frame": start_frame + whole, "time_offset": rest}


def about_data(
    dataset: Pair,
    frames: IntArray,
    offset: MeasuredOffset | None,
    validation: Mapping[str, Any] | None,
    forecast: ForecastEntries | None,
) -> dict[str, Any]:
    """The fields of a parameter set on its data and its figures.

    Args:
        frames: numbers of the calibration frames.
        offset: as of `timing`.
        validation: its `threshold_px` becomes the matching threshold, else the forecast one.
    """
    limit = None if forecast is None else forecast.figures["threshold_px"]["value"]
    limit = validation["threshold_px"] if validation else limit
    return {
        "inputs": {
            "sha256": dataset.sha256,
            "name": dataset.name,
            "baseline_m": dataset.baseline_m,
            **({"baseline": BASELINE_FOUND} if dataset.baseline_is_free else {}),
            "target_distance_m": dataset.target_distance_m,
            "frames": [int(frame) for frame in frames],
        },
        "matching_threshold_px": None if limit is None else float(limit),
        "validation": validation,
        "predicted": None if forecast is None else forecast.figures,
        "camera_names": dataset.camera_names,
        **timing(dataset.start_frame, offset),
    }


def _object(data: Any, name: str) -> Any:
    """An entry of the file that is kept unchanged."""
    refuse((not isinstance(data, dict), f"{name} is not an object."))
    try:
        json.dumps(data, allow_nan=False)
    except ValueError as error:
        raise StereocalError(
            f"{name} has a number that is not finite (NaN or infinite)."
        ) from error
    return data
