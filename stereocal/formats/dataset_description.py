"""`dataset.json`: what a data set of format 1 or 2 says beside its points."""

import difflib
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from itertools import permutations
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from stereocal.errors import StereocalError, naming
from stereocal.formats.camera_file import read_camera
from stereocal.formats.window_entry import WINDOW, windows_in
from stereocal.rig.camera import CAMERAS, Camera, LensModel
from stereocal.rig.frame_rates import RATES
from stereocal.rig.measured_lengths import check_length, check_lengths, check_uncertainty
from stereocal.rig.recording import NO_POINTS, CameraPair, Recording
from stereocal.rig.rigid_object import BoardPattern, RigidObject
from stereocal.system.json_text import read_json
from stereocal.system.names import check_camera_names, label_of
from stereocal.system.records import of_plain, settings_of

DATASET_FORMAT = "stereocal-dataset/1"
"""Two cameras and a bar, with `correspondences.csv`."""
RECORDING_FORMAT = "stereocal-dataset/2"
"""Any cameras and any rigid object, with `points.csv`."""
DESCRIPTION = "dataset.json"
HOW_MADE = (
    " Of a table of points and camera files `python -m stereocal import` makes one; the Data page "
    "takes photographs and such files as they are."
)
LARGEST_DESCRIPTION = 4_000_000
TABLE, POINTS = "correspondences.csv", "points.csv"
"""The table of points of format 1, and of format 2."""
FREE = "free"
"""`baseline_sigma_m` of a baseline that is not measured, but found from the lengths."""
STARTS = "start_frames"
"""The entry that says which frame was 0 of each camera that counted its own."""
ENTRIES = (
    *("format", "name", "notes", "cameras", "points", "frames", STARTS, RATES, "object"),
    *("baseline_m", "baselines_m", "baseline_sigma_m"),
    *("target_distance_m", "target_distance_sigma_m", "object_sigma_m"),
    WINDOW,
)
"""Those of `dataset.json`; others that look like one of these are taken for slips of the pen."""
ALIKE = 0.85
BOARD = "board"


@dataclass(frozen=True)
class Description:
    """The `dataset.json` among files by name."""

    files: Mapping[str, bytes]
    source: str
    folder: str
    """The folder of the file, with its slash, or empty."""
    entries: Mapping[str, Any]

    @property
    def where(self) -> str:
        """What errors begin with."""
        return f"{self.source}: {DESCRIPTION}"

    @property
    def is_recording(self) -> bool:
        """Whether it is of format 2."""
        return bool(self.entries["format"] == RECORDING_FORMAT)

    @property
    def name(self) -> str:
        """The name of the data set, as it can be displayed."""
        return label_of(str(self.entries.get("name") or Path(self.source).stem))

    @property
    def counts_own_frames(self) -> bool:
        """Whether each camera counts its own frames, as cameras that were started by hand."""
        counted = self.entries.get("frames", "common")
        if counted not in ("own", "common"):
            raise StereocalError(f'{self.where}: "frames" must be "own" or "common".')
        if counted == "common" and self.entries.get(RATES) is not None:
            raise StereocalError(f'{self.where}: "{RATES}" is for cameras with "frames": "own".')
        return bool(counted == "own")

    @property
    def start_frames(self) -> dict[str, int]:
        """Which frame was frame 0 of each camera that counted its own; empty if not stated."""
        stated, starts = self.entries.get(STARTS), dict[str, int]()
        if not self.is_recording:
            late = stated.get("secondary") if isinstance(stated, dict) else None
            return {CAMERAS[0]: 0, CAMERAS[1]: late} if isinstance(late, int) and late else {}
        if stated is not None:
            with suppress(ValueError):
                starts = of_plain(stated, dict[str, int])
            if starts.keys() != self.entries["cameras"].keys():
                raise StereocalError(
                    f'"{STARTS}" must give a whole number of each camera.', self.source
                )
        return starts

    def recording(self, lens_model: LensModel | None) -> Recording:
        """The recording that it describes, still without points."""
        cameras = self.cameras(lens_model)
        if self.is_recording:
            rigid_object, sigma = _object(self), self.optional_length("baseline_sigma_m")
            baselines = _baselines(self, cameras)
        else:
            rigid_object, baselines, sigma = self._bar_and_baseline()
        with naming(self.where):
            windows = windows_in(self.entries.get(WINDOW), cameras)
        return Recording(
            self.name,
            cameras,
            rigid_object,
            *NO_POINTS,
            baselines_m=baselines,
            baseline_sigma_m=sigma,
            notes=str(self.entries.get("notes", "")),
            start_frames={} if self.is_recording else self.start_frames,
            windows=windows,
        )

    def _bar_and_baseline(self) -> tuple[RigidObject, dict[CameraPair, float], float | None]:
        """The lengths of format 1. What it states of a free baseline is not used."""
        free = self.entries.get("baseline_sigma_m") == FREE
        baseline_m, bar_m = self.length("baseline_m"), self.length("target_distance_m")
        sigma = np.inf if free else self.optional_length("baseline_sigma_m")
        bar_sigma = self.optional_length("target_distance_sigma_m")
        with naming(self.source):
            check_lengths(baseline_m, bar_m, sigma, bar_sigma)
        return RigidObject.bar(bar_m, bar_sigma), {} if free else {CAMERAS: baseline_m}, sigma

    def cameras(self, lens_model: LensModel | None) -> dict[str, Camera]:
        """The cameras of the files that it names: primary and secondary in format 1."""
        named = self.entries.get("cameras")
        wanted = () if self.is_recording else CAMERAS
        if not isinstance(named, dict) or len(named) < 2 or not set(wanted) <= named.keys():
            which = "two cameras at least" if self.is_recording else "the primary and the secondary"
            raise StereocalError(f'{self.where}: "cameras" must name the files of {which}.')
        with naming(self.where):
            check_camera_names(wanted or named)
        cameras = {}
        for which in wanted or named:
            name = named[which]
            if not isinstance(name, str) or self.folder + name not in self.files:
                raise StereocalError(
                    f"{self.source}: the {which}'s camera file {name!r} is missing."
                )
            content, source = self.files[self.folder + name], f"{self.source}: {name}"
            cameras[which] = read_camera(content, source, lens_model)
        return cameras

    def length(self, key: str) -> float:
        """An entry in metres that must be there."""
        value = self.optional_length(key)
        if value is None:
            raise StereocalError(f"{self.where}: {key} is missing.")
        return value

    def optional_length(self, key: str, of: Mapping[str, Any] | None = None) -> float | None:
        """An entry in metres; None if there is none. Its value is not checked here."""
        value = (self.entries if of is None else of).get(key)
        try:
            return of_plain(value, float | None)  # type: ignore[arg-type]
        except ValueError as error:
            raise StereocalError(
                f"{self.where}: {key} is {str(value)[:60]!r}; it must be a number, in metres."
            ) from error


def find_description(files: Mapping[str, bytes], source: str) -> Description:
    """The only `dataset.json` among files, which may all be in one subfolder."""
    paths = [
        name
        for name in files
        if PurePosixPath(name).name == DESCRIPTION and not name.startswith("__MACOSX/")
    ]
    if not paths:
        zips = [name for name in files if name.lower().endswith(".zip")]
        inside = f" It holds the zip {zips[0][:60]}: unpack that, and give it." if zips else ""
        raise StereocalError(
            f"there is no {DESCRIPTION} in it, which names the cameras and their lengths."
            f"{inside or HOW_MADE}",
            source,
        )
    if len(paths) > 1:
        raise StereocalError(
            f"{source}: it contains {len(paths)} data sets ({', '.join(sorted(paths)[:3])}); "
            "use one at a time."
        )
    content = files[paths[0]]
    if len(content) > LARGEST_DESCRIPTION:
        raise StereocalError(f"{source}: {len(content)} bytes are too many for a {DESCRIPTION}.")
    entries = read_json(content, f"{source}: {DESCRIPTION}")
    known = (DATASET_FORMAT, RECORDING_FORMAT)
    if not isinstance(entries, dict) or entries.get("format") not in known:
        raise StereocalError(
            f'{source}: {DESCRIPTION} must be an object with "format": "{DATASET_FORMAT}", or '
            f'"{RECORDING_FORMAT}".'
        )
    for entry in entries.keys() - {*ENTRIES}:
        if meant := difflib.get_close_matches(str(entry), ENTRIES, 1, ALIKE):
            raise StereocalError(
                f'{source}: {DESCRIPTION}: "{entry[:60]}" is not known: write "{meant[0]}".'
            )
    return Description(files, source, paths[0][: -len(DESCRIPTION)], entries)


def _object(description: Description) -> RigidObject:
    """The object that `dataset.json` describes: points by name, or a board."""
    described = description.entries.get("object")
    sigma = description.optional_length("object_sigma_m")
    with naming(description.where):
        if not isinstance(described, dict) or not described:
            raise StereocalError(
                '"object" must give the points of the object in metres, as {"A": [0, 0, 0], "B": '
                '[0.39, 0, 0]}, or a board: {"board": {"columns": 9, "rows": 6, "square_m": 0.03}}.'
            )
        if BOARD in described:
            board = settings_of(described[BOARD], BoardPattern, "board")
            rigid_object = RigidObject.of_board(board, sigma)
        else:
            points = []
            for name, xyz in described.items():
                try:
                    points.append(of_plain(xyz, tuple[float, float, float]))
                except ValueError as error:
                    raise StereocalError(
                        f"the point {name[:40]!r} must be three numbers, in metres."
                    ) from error
            rigid_object = RigidObject(tuple(described), np.array(points), sigma)
        longest = rigid_object.longest_m
        check_length("longest distance between points of the object", longest)
        check_uncertainty("object", sigma, longest)
        return rigid_object


def _baselines(description: Description, cameras: Iterable[str]) -> dict[CameraPair, float]:
    """The measured baselines by pair of cameras."""
    where, stated = description.where, description.entries.get("baselines_m") or {}
    if not isinstance(stated, dict):
        raise StereocalError(f'{where}: "baselines_m" must give lengths by pair of cameras.')
    pairs = {f"{a}-{b}": (a, b) for a, b in permutations(cameras, 2)}
    baselines: dict[CameraPair, float] = {}
    for key in stated:
        value = description.optional_length(key, stated)
        if key not in pairs:
            raise StereocalError(
                f"{where}: the baseline {key[:60]!r} is of no pair of cameras: {', '.join(pairs)}."
            )
        if value is not None:
            with naming(where):
                check_length(f"baseline {key}", value)
            if pairs[key][::-1] in baselines:
                raise StereocalError(f"{where}: the baseline {key} is stated twice.")
            baselines[pairs[key]] = value
    return baselines
