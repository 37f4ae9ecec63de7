"""A recording of one object by any number of cameras; any two of them are a data set."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from unicodedata import category

import numpy as np

from stereocal.errors import RefusedRowsError, RowProblem, StereocalError
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.compiled import BoolArray, FloatArray, IntArray
from stereocal.rig.correspondences import TARGETS, Correspondences
from stereocal.rig.dataset import Dataset
from stereocal.rig.field_of_view import beyond_view
from stereocal.rig.rigid_object import RigidObject
from stereocal.system.numbers import count

LONGEST_NAME = 64
LETTERS, OTHERS = "LMN", " -_."
"""Categories of characters: letters, marks on letters, numbers; and other characters."""
CameraPair = tuple[str, str]
MOST_IMAGES = 50_000_000
"""The most images of all targets in all frames and cameras: 800 MB of pixels."""


@dataclass(frozen=True, eq=False)
class Recording:
    """Image points of the targets of an object, one row per frame, camera and target.

    All arrays have n rows. Pixels are raw (distorted); (0, 0) is the centre of the top-left pixel.
    """

    name: str
    cameras: Mapping[str, Camera]
    """By name. The first of two is the primary."""
    object: RigidObject
    frame: IntArray
    camera: IntArray
    """Index into `cameras`."""
    target: IntArray
    """Index into `object.names`."""
    points: FloatArray
    """(n, 2)."""
    sigma_px: FloatArray
    """Standard error of each coordinate; NaN if unknown."""
    baselines_m: Mapping[CameraPair, float] = field(default_factory=dict)
    """The measured baselines; each pair in one order or the other."""
    baseline_sigma_m: float | None = None
    notes: str = ""
    beyond_view: Mapping[str, int] = field(default_factory=dict)
    """By camera, how many points were left out by `within_view`."""

    def __post_init__(self) -> None:
        check_camera_names(self.cameras)

    @classmethod
    def of_pair(cls, dataset: Dataset) -> "Recording":
        """The recording of a data set, with the points as recorded."""
        rows = dataset.correspondences
        rigid_object = rows.rigid_object
        if rigid_object is None:
            rigid_object = RigidObject.bar(
                dataset.target_distance_m, dataset.target_distance_sigma_m
            )
        free = dataset.baseline_is_free
        return cls(
            name=dataset.name,
            cameras=dict(zip(CAMERAS, (dataset.primary, dataset.secondary), strict=True)),
            object=replace(rigid_object, sigma_m=dataset.target_distance_sigma_m),
            frame=np.tile(rows.frame, 2),
            camera=np.repeat([0, 1], len(rows)),
            target=np.tile(rows.target, 2),
            points=np.vstack([rows.primary, rows.recorded_secondary]),
            sigma_px=np.concatenate([rows.sigma_primary_px, rows.sigma_secondary_px]),
            baselines_m={} if free else {CAMERAS: dataset.baseline_m},
            baseline_sigma_m=None if free else dataset.baseline_sigma_m,
            notes=dataset.notes,
        )

    def refuse_points_outside(self) -> None:
        """Raise an error if points are outside their image."""
        problems = []
        for number, (name, camera) in enumerate(self.cameras.items()):
            own = self.where(self.camera == number)
            for row, what in camera.outside(own.points):
                target = self.object.names[own.target[row]]
                reason = f"frame {own.frame[row]}, camera {name}, target {target}: the {what}"
                problems.append(RowProblem(0, reason))
        if problems:
            raise RefusedRowsError("", problems, "cannot be used")

    def within_view(self) -> "Recording":
        """The recording without points that a fisheye images farther from its axis than it is used;
        `beyond_view` counts them.

        Raises:
            StereocalError: more than half of a camera's points are there.
        """
        beyond, counts = np.zeros(len(self.frame), dtype=np.bool_), dict[str, int]()
        for number, (name, camera) in enumerate(self.cameras.items()):
            own = np.flatnonzero(self.camera == number)
            beyond[own] = beyond_view(camera, self.points[own], name)
            counts[name] = int(beyond[own].sum())
        return replace(self.where(~beyond), beyond_view=counts) if beyond.any() else self

    def where(self, kept: BoolArray) -> "Recording":
        """The rows for which `kept` (n,) is true."""
        columns = ("frame", "camera", "target", "points", "sigma_px")
        return replace(self, **{name: getattr(self, name)[kept] for name in columns})

    def of_cameras(self, names: Sequence[str]) -> "Recording":
        """The recording with some of its cameras only, in the order of all."""
        every = list(self.cameras)
        if list(names) == every:
            return self
        numbers = np.array([names.index(name) if name in names else -1 for name in every])
        found = self.where(numbers[self.camera] >= 0)
        return replace(
            found,
            cameras={name: self.cameras[name] for name in names},
            camera=numbers[found.camera],
            baselines_m={
                pair: length for pair, length in self.baselines_m.items() if {*pair} <= {*names}
            },
        )

    def images(self, values: FloatArray | None = None) -> tuple[IntArray, FloatArray]:
        """The frame numbers (f,), and the pixels of all targets (f, k, c, 2); NaN where not seen.

        Args:
            values: (n, v): others of the rows, instead of their pixels.
        """
        of_rows = self.points if values is None else values
        frames, at = np.unique(self.frame, return_inverse=True)
        shape = len(frames), len(self.object.names), len(self.cameras)
        if math.prod(shape) > MOST_IMAGES:
            raise StereocalError(
                f"{shape[0]} frames of an object with {shape[1]} points before {shape[2]} cameras "
                "are too many: name only the points that are seen, or take fewer frames."
            )
        found = np.full((*shape, of_rows.shape[1]), np.nan)
        found[at, self.target, self.camera] = of_rows
        return frames, found

    @property
    def pairs(self) -> list[CameraPair]:
        """All pairs of cameras, in the cameras' order."""
        return list(combinations(self.cameras, 2))

    def pair_named(self, text: str) -> CameraPair:
        """The pair of a name such as `left-right`, in its order."""
        for first, second in self.pairs:
            for found in ((first, second), (second, first)):
                if text == "-".join(found):
                    return found
        raise StereocalError(f'There is no pair "{text[:60]}". {self.describe_pairs()}')

    def describe_pairs(self) -> str:
        """The pairs and how many frames both cameras of each see."""
        seen = [f"{a}-{b} ({count(len(self.common_frames(a, b)), 'frame')})" for a, b in self.pairs]
        return f"Pairs and the frames that both cameras see: {', '.join(seen)}."

    def common_frames(self, first: str, second: str) -> IntArray:
        """The frames in which both cameras see the same target, ascending."""
        return np.unique(self.frame[self._common(first, second)[0]])

    def baseline_m(self, first: str, second: str) -> float | None:
        """The measured distance of two cameras; None if it is free."""
        return self.baselines_m.get((first, second), self.baselines_m.get((second, first)))

    def pair(self, first: str, second: str) -> Dataset:
        """The data set of two cameras, of the points that both see.

        A baseline that was not measured is free, and 1 m until it is found.
        """
        a, b = self._common(first, second)
        if not len(a):
            raise StereocalError(
                f"The cameras {first} and {second} see no point in the same frame. "
                f"{self.describe_pairs()}"
            )
        measured, names = self.baseline_m(first, second), self.object.names
        return Dataset(
            name=self.name if len(self.cameras) == 2 else f"{self.name}, {first}-{second}",
            primary=self.cameras[first],
            secondary=self.cameras[second],
            correspondences=Correspondences.from_arrays(
                self.frame[a],
                [names[target] for target in self.target[a].tolist()],
                self.points[a],
                self.points[b],
                sigma_primary_px=self.sigma_px[a],
                sigma_secondary_px=self.sigma_px[b],
                rigid_object=None if names == TARGETS else self.object,
            ),
            baseline_m=1.0 if measured is None else measured,
            target_distance_m=self.object.longest_m,
            baseline_sigma_m=np.inf if measured is None else self.baseline_sigma_m,
            target_distance_sigma_m=self.object.sigma_m,
            notes=self.notes,
            camera_names=None if (first, second) == CAMERAS else (first, second),
            beyond_view={name: self.beyond_view.get(name, 0) for name in (first, second)},
        )

    def _common(self, first: str, second: str) -> tuple[IntArray, IntArray]:
        """The rows of two cameras with the same target in the same frame, in the first's order."""
        names = list(self.cameras)
        rows = [np.flatnonzero(self.camera == names.index(name)) for name in (first, second)]
        width = len(self.object.names)
        of_first, of_second = (
            self.frame[of_camera] * width + self.target[of_camera] for of_camera in rows
        )
        _, one, other = np.intersect1d(of_first, of_second, True, return_indices=True)
        order = np.argsort(one)
        return rows[0][one[order]], rows[1][other[order]]


def check_camera_names(names: Iterable[str]) -> None:
    """Refuse names that cannot be part of the name of a file, and pairs whose files would be one.

    Raises:
        StereocalError: names the camera.
    """
    names = [*names]
    for name in names:
        known = all(sign in OTHERS or category(sign)[0] in LETTERS for sign in name)
        whole = 0 < len(name.strip(" ")) == len(name) <= LONGEST_NAME
        if not (known and whole) or name[0] == ".":
            raise StereocalError(
                f"A camera cannot be called {name[:LONGEST_NAME]!r}, since files are named after "
                f"it: rename it, with 1 to {LONGEST_NAME} letters, digits, spaces, -, _ or . (no "
                "dot at the beginning)."
            )
    pairs: dict[str, tuple[str, str]] = {}
    for pair in combinations(names, 2):
        other = pairs.setdefault("-".join(pair).casefold(), pair)
        if other != pair:
            raise StereocalError(
                f"The files of the cameras {' and '.join(other)} and those of {' and '.join(pair)} "
                "would have one name: rename a camera."
            )
