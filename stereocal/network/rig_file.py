"""`rig.json`: the cameras of a rig in one frame, with their errors and what the pairs say."""

from __future__ import annotations

import datetime
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from stereocal.errors import DAMAGED, StereocalError
from stereocal.network.fuse import Fused, PairFit
from stereocal.network.pair_of_rig import pair_name
from stereocal.network.result import RigCalibration
from stereocal.network.third_camera import third_cameras
from stereocal.network.unknowns import camera_at
from stereocal.network.views import EACH
from stereocal.rig.camera import LENS_UNKNOWNS, Camera
from stereocal.rig.compiled import FloatArray
from stereocal.rig.geometry import Pose
from stereocal.rig.parameters import PIXEL_ORIGIN, software_versions
from stereocal.rig.rigid_object import RigidObject
from stereocal.rig.volume import Volume
from stereocal.system.json_text import read_json

RIG = "rig.json"
RIG_FORMAT = "stereocal-rig/1"
CONVENTION = "x_camera = R @ x_reference + T"
UNITS = {"T": "m", "K": "px", "covariance": "rad, m, px", "noise_px": "px"}
ROTATION = ("turn_x", "turn_y", "turn_z")
OF_CAMERA = (*ROTATION, "x", "y", "z", *LENS_UNKNOWNS, "time_offset")


@dataclass(frozen=True, eq=False)
class RigFile:
    """The content of `rig.json` that is used again; `about` is all the rest of it."""

    cameras: Mapping[str, Camera]
    """By name; the first is the reference."""
    poses: Mapping[str, Pose]
    """`camera_from_reference`."""
    time_offsets: Mapping[str, float]
    """By how many frames each camera is late."""
    covariance: FloatArray
    """(Q, Q): of the unknowns of `views`."""
    noise_px: float
    about: Mapping[str, Any]
    volume: Volume | None = None
    """Where the object was, as the reference sees it; None if not in front of it."""

    @property
    def names(self) -> list[str]:
        return list(self.cameras)

    def to_json(self) -> dict[str, Any]:
        """The content of the file."""
        errors = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        cameras = {}
        for number, (name, camera) in enumerate(self.cameras.items()):
            own = errors[EACH * number : EACH * (number + 1)].tolist()
            cameras[name] = {
                **camera.to_json(),
                "R": self.poses[name].R.tolist(),
                "T": self.poses[name].T.tolist(),
                "time_offset_frames": self.time_offsets[name],
                "standard_errors": dict(zip(OF_CAMERA, own, strict=True)),
            }
        of = [f"{name} {what}" for name in self.cameras for what in OF_CAMERA]
        return {
            "format": RIG_FORMAT,
            "convention": CONVENTION,
            "units": UNITS,
            "pixel_origin": PIXEL_ORIGIN,
            "reference": self.names[0],
            "cameras": cameras,
            "noise_px": self.noise_px,
            "volume": None if self.volume is None else self.volume.to_json(),
            **self.about,
            "covariance": self.covariance.tolist(),
            "covariance_of": [*of, "object_factor"],
            "software": software_versions(),
            "created": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        }

    def dumps(self) -> str:
        """The file as text."""
        return json.dumps(self.to_json(), indent=1, allow_nan=False) + "\n"

    @classmethod
    def load(cls, path: str | Path) -> RigFile:
        """Read a file.

        Raises:
            StereocalError: it cannot be read or is not a valid rig.
        """
        try:
            text = Path(path).read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise StereocalError(f"{path}: the file cannot be read ({error}).") from error
        return cls.loads(text, str(path))

    @classmethod
    def loads(cls, text: str, source: str = "rig.json") -> RigFile:
        """As `load`, from text."""
        data = read_json(text, source)
        found = data.get("format") if isinstance(data, dict) else None
        if found != RIG_FORMAT or data.get("convention") != CONVENTION:
            raise StereocalError(
                f'{source}: the format is {found!r}; this version reads "{RIG_FORMAT}" with the '
                f'convention "{CONVENTION}".'
            )
        try:
            return cls._of(data, source)
        except StereocalError as error:
            raise StereocalError(f"{source}: {error}") from error
        except DAMAGED as error:
            raise StereocalError(
                f"{source}: the rig is damaged ({type(error).__name__}: {error})."
            ) from error

    @classmethod
    def _of(cls, data: Mapping[str, Any], source: str) -> RigFile:
        cameras = {
            name: Camera.from_json(own, f"camera {name}") for name, own in data["cameras"].items()
        }
        covariance = np.array(data["covariance"], dtype=np.float64)
        size = EACH * len(cameras) + 1
        if len(cameras) < 2 or covariance.shape != (size, size):
            raise StereocalError("the cameras and the covariance do not belong together.")
        if not np.isfinite(covariance).all():
            raise StereocalError("the covariance has a number that is not finite.")
        own = {*RigFile.__dataclass_fields__, "format", "convention", "units", "pixel_origin"}
        own |= {"reference", "covariance_of", "software", "created"}
        volume = data.get("volume")
        _check_figures(data)
        return cls(
            cameras,
            {
                name: Pose(np.array(each["R"], float), np.array(each["T"], float))
                for name, each in data["cameras"].items()
            },
            {name: float(each["time_offset_frames"]) for name, each in data["cameras"].items()},
            covariance,
            float(data["noise_px"]),
            {name: value for name, value in data.items() if name not in own},
            None if volume is None else Volume.from_json(volume, source),
        )


def _check_figures(data: Mapping[str, Any]) -> None:
    """Look up what is told of a rig; a KeyError, TypeError or ValueError if it is not there."""
    numbers: list[Any] = []
    if "figures" in data:
        figures = data["figures"]
        numbers += [figures["reprojection_px"], figures["frames"]]
        numbers += [
            figures["length_error_p95"] or 0,
            *(value or 0 for value in data["image_errors_px"].values()),
        ]
        if figures["weakest_camera"] not in data["cameras"]:
            raise ValueError("the weakest camera")
    for own in data["pairs"].values():
        one, other = own["cameras"]
        numbers += [own["bars"], len(one), len(other)]
    for loop in data.get("loops", []):
        numbers += [*loop["before"].values(), len("".join(loop["cameras"]))]
    for own in data.get("third_camera_px", []):
        numbers += [own["before"], own["after"], len("".join([*own["pair"], own["camera"]]))]
    for own in data.get("wrong_images", []):
        numbers += [own["frame"], len(own["camera"]), len(own["target"] or ""), own["exchanged"]]
    words = [*data.get("warnings", []), *data.get("not_connected", {}).values()]
    numbers += [len("".join(words)), *data.get("frames_left_out", [])]
    if not np.isfinite(np.array(numbers, dtype=np.float64)).all():
        raise ValueError("a figure that is not finite")


def holds_rig(path: Path) -> bool:
    """Whether a file is a rig's, of any version."""
    try:
        with path.open(encoding="utf-8") as file:
            return '"stereocal-rig/' in file.read(200)
    except (OSError, UnicodeDecodeError):
        return False


def rig_file(rig: RigCalibration) -> RigFile:
    """The file of a calibrated rig."""
    points = rig.point_fits[0][~rig.fit.outlying[rig.fit.placings.of_frame]].reshape(-1, 3)
    points = points[np.isfinite(points[:, 0])]
    late = dict(zip(rig.names, rig.time_offsets.tolist(), strict=True))
    about = {
        "object": {**_object(rig.recording.object), "factor": rig.object_factor},
        "figures": {
            "reprojection_px": float(np.sqrt(np.nanmean(np.square(rig.reprojection_px)))),
            "length_error_p95": float(np.quantile(np.abs(rig.length_errors), 0.95))
            if len(rig.length_errors)
            else None,
            "frames": len(rig.used),
            "independent_frames": rig.clusters.count,
            "design_effect": rig.design_effect,
            "weakest_camera": rig.weakest,
        },
        "image_errors_px": {
            name: own.image_px if np.isfinite(own.image_px) else None
            for name, own in rig.errors.items()
        },
        "frames_left_out": list(rig.left_out),
        "wrong_images": [
            {"frame": own.frame, "camera": own.camera, "target": own.target}
            | {"exchanged": own.exchanged}
            for own in rig.wrong
        ],
        "loops": [
            {
                "cameras": list(loop.cameras),
                "rotation_deg": 0.0,
                "translation_m": 0.0,
                "before": {"rotation_deg": loop.rotation_deg, "translation_m": loop.translation_m},
            }
            for loop in rig.loops
        ],
        "third_camera_px": [
            {"pair": list(own.cameras[:2]), "camera": own.cameras[2], "points": own.points}
            | {"before": own.before_px, "after": own.after_px}
            for own in third_cameras(rig)
        ],
        "pairs": _pairs(rig),
        "not_connected": dict(rig.unreached),
        "warnings": list(rig.warnings),
    }
    sighted = points[:, 2].min() > 0 if len(points) else False
    return RigFile(
        rig.cameras,
        rig.poses,
        late,
        rig.covariance,
        float(rig.fit.sigma_px),
        about,
        Volume.of_bars(points) if sighted else None,
    )


def fused_file(stated: Mapping[str, Camera], pairs: list[PairFit], fused: Fused) -> RigFile:
    """The file of fused pairs, whose points are not known."""
    q, M = fused.unknowns.origin + fused.unknowns.M @ fused.p, fused.unknowns.M
    covariance = M @ fused.unknowns.covariance(fused.information) @ M.T
    noise = float(np.sqrt(np.mean([own.noise_px**2 for own in pairs])))
    cameras = {name: camera_at(own, q, number) for number, (name, own) in enumerate(stated.items())}
    return RigFile(
        cameras,
        dict(zip(stated, fused.poses, strict=True)),
        {name: float(q[EACH * number + EACH - 1]) for number, name in enumerate(stated)},
        np.asarray(covariance),
        noise,
        {
            "object": {"factor": float(q[-1])},
            "frames_left_out": [],
            "pairs": {
                pair_name((own.first, own.second)): {
                    "cameras": [own.first, own.second],
                    "bars": own.frames,
                    "frames": own.frames,
                    "noise_px": own.noise_px,
                    "chi_square_growth": fused.misfits[own.first, own.second],
                }
                for own in pairs
            },
        },
    )


def _pairs(rig: RigCalibration) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for pair, bars in rig.pairs.bars.items():
        own = rig.pairs.fits.get(pair)
        found[pair_name(pair)] = {
            "cameras": list(pair),
            "bars": bars,
            **({} if own is None else {"frames": own.frames, "noise_px": own.noise_px}),
            **({"failed": rig.pairs.failed[pair]} if pair in rig.pairs.failed else {}),
        }
    return found


def _object(own: RigidObject) -> dict[str, Any]:
    return dict(zip(own.names, own.points.tolist(), strict=True))
