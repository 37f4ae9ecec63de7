"""Match the unlabelled points of two images by the reprojection error of each pair.

    matches = match_points(rig, primary_px, secondary_px, threshold_px=0.6)

A pair is a candidate if its reprojection error (mean over both cameras, px) is within the
threshold. Matching takes the one-to-one assignment of candidates with the least total cost: a pair
costs its error, and leaving a point unmatched costs the threshold, so two poor pairs cannot
displace a good one.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import min_weight_full_bipartite_matching

from stereocal.errors import StereocalError
from stereocal.matching.pairs_of_rig import pairs_of
from stereocal.rig.camera import CAMERAS
from stereocal.rig.parameters import RigParameters
from stereocal.system.array_types import FloatArray, IntArray
from stereocal.system.numbers import POSSIBLE_PX, rounded

ANY_DEPTH = (0.0, float("inf"))


@dataclass(frozen=True, eq=False)
class Matches:
    """The pairs of one frame, in the order of the primary's points."""

    primary: IntArray
    """(k,) rows of the primary's points."""
    secondary: IntArray
    """(k,) rows of the secondary's points."""
    error_px: FloatArray
    """(k,) reprojection error, mean over both cameras."""
    runner_up_px: FloatArray
    """(k,) least error of any other pair with one of the two points; NaN if there is none."""
    ambiguous: npt.NDArray[np.bool_]
    """(k,) whether the runner-up is within the threshold as well."""

    def __len__(self) -> int:
        return len(self.primary)


def match_points(
    rig: RigParameters,
    primary_px: npt.ArrayLike,
    secondary_px: npt.ArrayLike,
    threshold_px: float | None = None,
    depths_m: tuple[float, float] = ANY_DEPTH,
) -> Matches:
    """Match the points of one frame.

    Args:
        primary_px: (n, 2) raw pixels; `secondary_px`: (m, 2).
        threshold_px: largest reprojection error of a pair; None: that of the parameter file.
        depths_m: nearest and farthest depth z of a pair's point in the primary's frame.
    """
    threshold = checked_threshold(rig, threshold_px)
    near, far = check_depths(depths_m)
    rays = rig.primary.rays_of(primary_px), rig.secondary.rays_of(secondary_px)
    first, second, errors, of_primary, of_secondary = pairs_of(rig, *rays, threshold, near, far)
    kept = assign(first, second, errors, threshold)
    i, j, error = first[kept], second[kept], errors[kept]
    # The least error of a point belongs to its own pair, or to another pair: the runner-up.
    two_least = of_primary[i], of_secondary[j]
    others = np.minimum(
        *(np.where(least[:, 0] < error, least[:, 0], least[:, 1]) for least in two_least)
    )
    return Matches(
        primary=i,
        secondary=j,
        error_px=error,
        runner_up_px=np.where(np.isfinite(others), others, np.nan),
        ambiguous=others <= threshold,
    )


def checked_threshold(rig: RigParameters, threshold_px: float | None) -> float:
    """The threshold to match with: `threshold_px`, or else that of the parameter file."""
    value = rig.matching_threshold_px if threshold_px is None else threshold_px
    if value is None:
        raise StereocalError(
            "The parameter file contains no matching threshold (calibrate --validation writes "
            "one): state one in pixels, or have it chosen from the points (auto)."
        )
    if not 0 <= value <= POSSIBLE_PX[1]:
        raise StereocalError(
            f"The threshold is {value} px: it must be a number of 0 or more, up to "
            f"{POSSIBLE_PX[1]:g}."
        )
    return float(value)


def check_depths(depths_m: Sequence[float]) -> tuple[float, float]:
    near, far = float(depths_m[0]), float(depths_m[1])
    if not 0 <= near < far:
        raise StereocalError(
            f"The depth range {near:g} to {far:g} m is not possible: the nearest must be 0 or "
            "more, and less than the farthest."
        )
    return near, far


def assign(first: IntArray, second: IntArray, errors: FloatArray, threshold: float) -> IntArray:
    """Rows of the candidates in the one-to-one assignment of least total cost, ordered by `first`.

    A candidate costs its error, an unmatched point costs `threshold`: that of a further column of
    its row, slightly above it, so that a candidate exactly at the threshold is accepted.
    """
    if not len(first):
        return np.empty(0, np.int64)
    is_free = (np.bincount(first)[first] == 1) & (np.bincount(second)[second] == 1)
    kept = np.flatnonzero(is_free)
    if len(kept) < len(first):  # solved without the pairs of points that have no other partner
        others = np.flatnonzero(~is_free)
        solved = _solve(first[others], second[others], errors[others], threshold)
        kept = np.concatenate([kept, others[solved]])
    return kept[np.argsort(first[kept])]


def _solve(first: IntArray, second: IntArray, errors: FloatArray, threshold: float) -> IntArray:
    rows, i = np.unique(first, return_inverse=True)
    columns, j = np.unique(second, return_inverse=True)
    further = np.arange(len(rows))
    unmatched = np.full(len(rows), np.nextafter(threshold, np.inf))
    # The added constant does not change the assignment; SciPy drops zeros.
    cost = np.concatenate([errors, unmatched]) + max(threshold, 1.0)
    entries = np.concatenate([i, further]), np.concatenate([j, len(columns) + further])
    table: Any = coo_array((cost, entries), shape=(len(rows), len(columns) + len(rows))).tocsr()
    partner = min_weight_full_bipartite_matching(table)[1]
    return np.flatnonzero(partner[i] == j)


def nearest_errors(
    rig: RigParameters,
    frames: Sequence[tuple[FloatArray, FloatArray]],
    depths_m: tuple[float, float] = ANY_DEPTH,
) -> FloatArray:
    """(n, 2): the least and second least reprojection error of each of the primary's points; inf
    where there is none.

    Args:
        frames: as of `threshold.choose_threshold`.
    """
    near, far = check_depths(depths_m)
    least = [np.empty((0, 2))]
    for primary, secondary in frames:
        rays = rig.primary.rays_of(primary[:, :2]), rig.secondary.rays_of(secondary[:, :2])
        least.append(pairs_of(rig, *rays, 0.0, near, far)[3])
    return np.concatenate(least)


def purpose_warning(rig: RigParameters, purpose: str) -> str | None:
    """A warning if a set is used for the other purpose; None if it fits, as a refined set does.

    Args:
        purpose: "matching" or "reconstruction".
    """
    warnings = {
        ("reconstruction", "matching"): "This is the 3D set, made for measuring: it accepts more "
        "wrong pairs than the 2D set. Match with parameters_2d.json.",
        ("matching", "reconstruction"): "This is the 2D set, made for matching: lengths are less "
        "accurate than with the 3D set. Measure with parameters_3d.json.",
    }
    return warnings.get((rig.purpose, purpose))


LARGEST_RELATIVE_DIFFERENCE = 0.05
LARGEST_ANGLE = np.radians(5.0)
WRONG_LENGTH = (
    " A measured length or a lens is wrong: see what disagrees (Calibrate, or the notes of "
    "calibrate), and calibrate again; or match and measure with one set."
)


def refuse_different_rigs(one: RigParameters, other: RigParameters) -> None:
    """Reject two parameter files that cannot be of the same rig.

    The sets of one rig differ by less than 1 % and 2 degrees; those of one recording differ by more
    where a measured length or a lens is wrong.
    """
    same = bool(one.inputs.get("sha256")) and one.inputs.get("sha256") == other.inputs.get("sha256")
    what = "of one recording, but do not fit each other" if same else "of different rigs"
    if (differs := next(_differences(one, other), None)) is not None:
        remedy = WRONG_LENGTH if same and not differs.startswith("the images") else ""
        raise StereocalError(f"The two parameter files are {what}: {differs}{remedy}")


def _differences(one: RigParameters, other: RigParameters) -> Iterator[str]:
    for which in CAMERAS:
        a, b = getattr(one, which), getattr(other, which)
        if a.image_size != b.image_size:
            first, second = (f"{w}x{h} px" for w, h in (a.image_size, b.image_size))
            yield f"the images of the {which} camera have {first} in one and {second} in the other."
        if a.model != b.model:
            yield f"the lens of the {which} camera is a fisheye in only one of them."
        if (a.window is None) != (b.window is None):
            yield f"the {which} camera looks through a window in only one of them."
        if abs(a.K[0, 0] / b.K[0, 0] - 1) > LARGEST_RELATIVE_DIFFERENCE:
            yield (
                f"the focal length of the {which} camera is {a.K[0, 0]:.1f} px in one and "
                f"{b.K[0, 0]:.1f} px in the other."
            )
    a, b = one.pose.baseline, other.pose.baseline
    if abs(a / b - 1) > LARGEST_RELATIVE_DIFFERENCE:
        yield f"the baseline is {rounded(a, 4)} m in one and {rounded(b, 4)} m in the other."
    turn = np.arccos(np.clip((np.trace(one.pose.R @ other.pose.R.T) - 1) / 2, -1, 1))
    swing = np.arccos(np.clip(one.pose.T @ other.pose.T / (a * b), -1, 1))
    if max(turn, swing) > LARGEST_ANGLE:
        angle = np.degrees(max(turn, swing))
        yield f"the poses of the cameras differ by {angle:.1f} degrees."
