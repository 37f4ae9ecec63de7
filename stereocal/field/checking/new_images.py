"""New images of a rig: a few bars, or matched points alone."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stereocal.calibration.methods import errors_of
from stereocal.errors import StereocalError
from stereocal.fit.timing.time_offset import usable_after
from stereocal.matching.in_step import how_counted
from stereocal.matching.measure_tables import points_outside_images
from stereocal.matching.point_table import PAIR_SIGMAS, PointTable
from stereocal.rig.camera import CAMERAS
from stereocal.rig.clusters import follow_each_other
from stereocal.rig.correspondences import PIXELS, Correspondences
from stereocal.rig.field_of_view import beyond_either, beyond_in_words
from stereocal.rig.pair import Pair
from stereocal.rig.parameters import RigParameters
from stereocal.rig.recording import Recording
from stereocal.rig.rig import Rig
from stereocal.rig.tracks import MeasuredOffset
from stereocal.system.array_types import FloatArray, IntArray
from stereocal.system.numbers import count, rounded

LARGEST = 1000
"""Pairs that are used; of more, as many are taken evenly."""
FEWEST_PAIRS = 8
AMBIGUOUS, THRESHOLDED = "ambiguous", "error_px"


@dataclass(frozen=True, eq=False)
class NewImages:
    """Pairs of points with the lenses of the parameters, in groups that are fitted together."""

    dataset: Pair
    """Its frames are the groups: those of the bars, or one for each matched pair."""
    numbers: IntArray
    """(f,): the frame number of each group, ascending."""
    bars: int
    """How many bars there are; 0 for matched points alone, which do not determine lengths."""
    notes: tuple[str, ...] = ()
    stated_px: float = 0.0
    """Noise of the points, if they state it: they need not be as exact as targets."""
    own: bool = False
    """Whether they are the images that the parameters come from."""

    @property
    def described(self) -> str:
        """Such as `5 bars` or `50 matched points`."""
        if self.bars:
            return count(self.bars, "bar")
        return count(len(self.numbers), "matched point")

    @property
    def follow_each_other(self) -> bool:
        """Whether each bar is near the one before it, as those of a bar that is waved."""
        rows = self.dataset.correspondences
        return follow_each_other(rows.primary[rows.bars[:, 0]])

    def stating(self, sigma_px: float | None) -> "NewImages":
        """These images with the noise of the points as stated (px); None: as they state it."""
        return self if sigma_px is None else replace(self, stated_px=sigma_px)

    def errors_with(self, rig: Rig) -> tuple[FloatArray, FloatArray]:
        """Errors of each group with a rig, (f,) each: reprojection in px, the mean of its points;
        and |reconstructed - stated| / stated length, NaN without a bar."""
        seen = self.dataset.changed(primary=rig.primary, secondary=rig.secondary)
        rows, errors = seen.correspondences, errors_of(seen, rig.pose)
        group, length = np.searchsorted(rows.frames, rows.frame), np.full(len(rows.frames), np.nan)
        length[group[rows.bars[:, 0]]] = errors.length
        return np.bincount(group, errors.reprojection_px) / np.bincount(group), length

    @property
    def is_of_bar(self) -> bool:
        """Whether the lengths are those of one bar with one stated length."""
        rows = self.dataset.correspondences
        has_own = bool(np.isfinite(rows.distance_m).any())
        return self.bars > 0 and rows.rigid_object is None and not has_own

    def times_as_long(self, rig: Rig) -> float:
        """How many times as long as stated the bar is with a rig, by the median."""
        seen = self.dataset.changed(primary=rig.primary, secondary=rig.secondary)
        lengths = seen.reconstructed_lengths_m(rig.pose) / seen.bar_distances_m
        return float(np.nanmedian(lengths)) if np.isfinite(lengths).any() else 1.0

    def with_bar(self, factor: float) -> "NewImages":
        """These images of a bar so many times as long, which is noted."""
        stated = self.dataset.target_distance_m
        note = (
            f"The bar seems to be another one than is stated: {rounded(stated * factor, 4)} m by "
            f"these images with the parameters, {rounded(stated, 4)} m as stated. With that length "
            "nothing else has changed. Measure it again."
        )
        dataset = self.dataset.changed(target_distance_m=stated * factor)
        return replace(self, dataset=dataset, notes=(*self.notes, note))

    def uncropped(self, names: Sequence[str], cut_px: FloatArray) -> "NewImages":
        """These images with the pixels (2,) that were cut off in front of those of some cameras,
        which is noted.

        Raises:
            StereocalError: points would be outside the whole images.
        """
        rows = self.dataset.correspondences
        whole = {name: getattr(rows, name) + cut_px for name in names}
        whose = "both cameras" if len(names) > 1 else f"the {names[0]}"
        note = (
            f"The images of {whose} seem to be cropped: with {cut_px[0]:.0f} px added to u and "
            f"{cut_px[1]:.0f} px to v nothing has changed. Give the points in pixels of the whole "
            "images, here and for all that is measured with the parameters."
        )
        dataset = self.dataset.changed(correspondences=replace(rows, **whole))
        return replace(self, dataset=dataset, notes=(*self.notes, note))

    def of_groups(self, groups: IntArray) -> "NewImages":
        """Some of the groups, by their indices."""
        frames = self.dataset.correspondences.frames[groups]
        part = self.dataset.of_frames(frames)
        return replace(
            self, dataset=part, numbers=self.numbers[groups], bars=len(part.correspondences.bars)
        )


def images_of_bars(dataset: Pair, rig: RigParameters) -> NewImages:
    """New images of a data set, seen with the lenses of the parameters."""
    for which in CAMERAS:
        size, wanted = getattr(dataset, which).image_size, getattr(rig, which).image_size
        if size != wanted:
            raise StereocalError(
                f"{dataset.name}: the {which}'s images are {size[0]}x{size[1]} px, and the "
                f"parameters are of {wanted[0]}x{wanted[1]} px: they are not of the same cameras, "
                "or the images were scaled."
            )
    used = dataset.of_frames(rig.inputs.get("frames") or [])
    # Of a long recording of which a few frames were calibrated, the others are new.
    mostly = 2 * len(used.correspondences.frames) > len(dataset.correspondences.frames)
    # The files of a rig's pairs name the whole recording.
    own = dataset.sha256, dataset.recording.sha256, used.sha256 if mostly else ""
    is_own = rig.inputs.get("sha256") in own
    seen = dataset.changed(primary=rig.primary, secondary=rig.secondary)
    rows = seen.correspondences
    notes = list(filter(None, [beyond_in_words(dataset.recording.beyond_view)]))
    if not len(rows.bars):
        return images_of_matches(
            rows.frame, rows.primary, rows.secondary, rig, dataset.name, tuple(notes)
        )
    offset = _offset_of(seen, rig)
    if offset is not None:
        seen = seen.shifted(offset)
        alone = np.isnan(seen.correspondences.motion[:, 0]) & offset.is_shift
        notes.append(
            "The secondary points were shifted by the time offset of the parameters, "
            f"{offset.frames:.3f} frames."
        )
        if alone.any():
            notes[-1] += (
                f" {alone.sum():,} of {len(rows):,} points have no neighbours in time and are used "
                "as recorded: the bar must have been at rest there."
            )
    if len(rows.frames) > LARGEST:
        kept = np.linspace(0, len(rows.frames) - 1, LARGEST).astype(np.int64)
        notes.append(f"{LARGEST:,} of {len(rows.frames):,} frames were used, evenly spaced.")
        seen = seen.of_frames(rows.frames[kept])
    rows = seen.correspondences
    return NewImages(seen, rows.frames, len(rows.bars), tuple(notes), own=is_own)


def _offset_of(seen: Pair, rig: RigParameters) -> MeasuredOffset | None:
    """The time offset of new bars, which may be counted apart as the calibrated ones were."""

    def misfit(tried: MeasuredOffset) -> float:
        rows = usable_after(seen, tried).correspondences
        errors = np.abs(rig.epipolar_errors(rows.primary, rows.secondary))
        return float(np.median(errors)) if len(errors) else np.inf

    offset = how_counted(rig, rig.start_frame - seen.start_frame, misfit)[0]
    return offset if offset.is_shift else None


def images_of_pairs(table: PointTable, rig: RigParameters) -> NewImages:
    """New images of a table of matched points, without those marked as ambiguous."""
    table.check(lambda block: points_outside_images(rig, block))
    frames, pixels, sigmas, ambiguous = [], [], [np.empty(0)], 0
    for frame, rows in table.frames():
        if AMBIGUOUS in rows:
            unsure = rows[AMBIGUOUS].astype(str).str.strip().str.lower().isin(("true", "1"))
            ambiguous += int(unsure.sum())
            rows = rows[~unsure.to_numpy()]
        frames.append(np.full(len(rows), frame, dtype=np.int64))
        pixels.append(rows[list(PIXELS)].to_numpy(dtype=np.float64))
        if set(PAIR_SIGMAS) <= set(rows):
            sigmas.append(rows[list(PAIR_SIGMAS)].to_numpy(dtype=np.float64).ravel())
    notes = []
    if ambiguous:
        notes.append(f"{ambiguous} ambiguous pairs were not used.")
    if THRESHOLDED in table.names:
        notes.append(
            "These pairs were matched by parameters. A large movement may have removed pairs: "
            "match again with a larger threshold."
        )
    matches = np.concatenate(pixels)
    images = images_of_matches(
        np.concatenate(frames), matches[:, :2], matches[:, 2:], rig, table.label, tuple(notes)
    )
    stated = np.concatenate(sigmas)
    stated = stated[np.isfinite(stated)]
    return replace(images, stated_px=float(np.sqrt(np.mean(stated**2))) if len(stated) else 0.0)


def images_of_matches(
    frames: IntArray,
    primary: FloatArray,
    secondary: FloatArray,
    rig: RigParameters,
    name: str,
    notes: tuple[str, ...] = (),
) -> NewImages:
    """New images of matched points alone, raw pixels (n, 2) of each camera."""
    lost, counts = beyond_either((rig.primary, rig.secondary), (primary, secondary))
    if note := beyond_in_words(counts):
        frames, primary, secondary = frames[~lost], primary[~lost], secondary[~lost]
        notes = (*notes, note)
    if len(frames) < FEWEST_PAIRS:
        raise StereocalError(
            f"{name}: {len(frames)} matched points are too few to check anything; at least "
            f"{FEWEST_PAIRS} are needed, better 50."
        )
    order = np.argsort(frames, kind="stable")
    if len(order) > LARGEST:
        notes = (*notes, f"{LARGEST:,} of {len(order):,} pairs were used, evenly spaced.")
        order = order[np.linspace(0, len(order) - 1, LARGEST).astype(np.int64)]
    rows = Correspondences.from_arrays(
        np.arange(len(order)), "A" * len(order), primary[order], secondary[order]
    )
    recording = Recording.of_two(name, rig.primary, rig.secondary, rig.pose.baseline, 1.0)
    return NewImages(recording.holding(rows).pair(*CAMERAS), frames[order], 0, notes)
