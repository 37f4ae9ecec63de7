"""Match the points of two cameras: what is settled before the first frame, and each frame."""

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from stereocal.errors import StereocalError
from stereocal.matching.matching import check_depths, match_points, purpose_warning
from stereocal.matching.names import (
    AUTO,
    NO_NAMES,
    WITHIN,
    Names,
    Sample,
    TwoCameras,
    choose_names,
    match_groups,
    texts,
)
from stereocal.matching.point_noise import noise_of_calibration, on_far, on_repaired
from stereocal.matching.point_table import PAIR_SIGMAS, SIGMA, pixels_of
from stereocal.matching.settled import ERROR_DECIMALS, Matching, Stated, further_of
from stereocal.matching.tables_by_camera import Report, TablesByCamera
from stereocal.matching.threshold import ThresholdChoice, choose_threshold, sample_of
from stereocal.rig.camera import CAMERAS
from stereocal.rig.correspondences import PIXELS
from stereocal.rig.parameters import RigParameters
from stereocal.system.array_types import IntArray
from stereocal.system.numbers import count, rounded

PAIR_COLUMNS = ("frame", *PIXELS, "error_px", "runner_up_px", "ambiguous")
FEW_MATCHED, MANY_LOST, USUAL_LOST = 0.1, 0.1, 0.05
MANY_POINTS = 100


def further_names(primary: tuple[Any, ...], secondary: tuple[Any, ...]) -> list[dict[str, str]]:
    """The further columns of both tables, and their names in the table of pairs.

    Unique names stay; names in both tables or in `PAIR_COLUMNS` get the camera's name added.

    Args:
        primary, secondary: all columns.
    """
    further = further_of(primary), further_of(secondary)
    taken = {*PAIR_COLUMNS} | ({*further[0]} & {*further[1]})
    return [
        {name: f"{name}_{which}" if name in taken else name for name in names}
        for which, names in zip(CAMERAS, further, strict=True)
    ]


def sample_frames(primary: pd.DataFrame, secondary: pd.DataFrame) -> Sample:
    """A sample of the frames common to both tables, to choose a threshold from."""
    common = np.intersect1d(primary["frame"], secondary["frame"])
    wanted = sorted(sample_of(common, len(primary) / max(primary["frame"].nunique(), 1)))
    sides = []
    for table in (primary, secondary):
        rows = table[table["frame"].isin(wanted)]
        sides.append(dict(list(rows.groupby("frame"))))
    return [(sides[0][frame], sides[1][frame]) for frame in wanted]


@dataclass(frozen=True, eq=False)
class BelowThreshold(Matching):
    """Points of two cameras that are pairs: those of least reprojection errors, below a
    threshold."""

    rig: RigParameters
    depths_m: tuple[float, float]
    threshold: ThresholdChoice

    @classmethod
    def of_tables(
        cls, rig: RigParameters, by_camera: TablesByCamera, stated: Stated
    ) -> "BelowThreshold":
        """Names and threshold by a sample of the frames."""
        check_depths(stated.depths_m)
        (first, one), (second, other) = by_camera.contents.items()
        common = np.intersect1d(one.frames, other.frames)
        if not len(common):
            a, b = (f"{contents.frames[0]} to {contents.frames[-1]}" for contents in (one, other))
            labels = [by_camera.tables[name].label for name in (first, second)]
            raise StereocalError(
                f"The two tables have no frame in common: {labels[0]} has frames {a}, {labels[1]} "
                f"has frames {b}. Use the same frame numbers in both."
            )
        wanted = sample_of(common.tolist(), one.rows / len(one.frames))
        sample = [(a, b) for frame, (a, b) in by_camera.side_by_side() if frame in wanted]
        names, note, chosen = names_and_threshold(rig, sample, by_camera.distinct, stated)
        further = further_names(*(table.further for table in by_camera.tables.values()))
        reported = ["ambiguous", *([WITHIN, *_named(names)] if names.columns else [])]
        return cls(
            (first, second), further, None, reported, names, note, rig, stated.depths_m, chosen
        )

    def groups(self, rows: Sequence[pd.DataFrame]) -> tuple[IntArray, dict[str, Any]]:
        """With `PAIR_SIGMAS` if the noise is that of the points, `WITHIN` if they have names."""
        threshold, noise = self.threshold.threshold_px, self.threshold.noise
        primary, secondary = map(pixels_of, rows)
        if self.names.columns:
            groups = self.names.groups(*rows)
            matches = match_groups(self.rig, primary, secondary, groups, threshold, self.depths_m)
        else:
            matches = match_points(self.rig, primary, secondary, threshold, self.depths_m)
        images = np.column_stack([matches.primary, matches.secondary])
        columns: dict[str, Any] = {
            "error_px": matches.error_px.round(ERROR_DECIMALS),
            "runner_up_px": matches.runner_up_px.round(ERROR_DECIMALS),
            "ambiguous": matches.ambiguous,
            **({WITHIN: matches.error_px <= threshold} if self.names.columns else {}),
        }
        if noise is not None and noise.source != "calibration":
            for name, table, image in zip(PAIR_SIGMAS, rows, images.T, strict=True):
                stated = noise.source == "columns" and SIGMA in table
                columns[name] = (
                    table[SIGMA].array[image] if stated else np.full(len(image), noise.sigma_px)
                )
        return images, columns

    def report(self, reported: pd.DataFrame, by_camera: TablesByCamera) -> Report:
        pairs, chosen = len(reported), self.threshold
        one, other = by_camera.contents.values()
        frames = len(np.intersect1d(one.frames, other.frames))
        by = f", of points of one name ({self.names.in_words})," if self.names.columns else ""
        sentence = (
            f"{count(pairs, 'pair')} in {count(frames, 'frame')}{by} at a threshold of "
            f"{rounded(chosen.threshold_px, 3)} px; {reported['ambiguous'].sum()} of them "
            "ambiguous (another partner is within the threshold as well); without partner: "
            f"{count(one.rows - pairs, 'point')} of the primary, "
            f"{other.rows - pairs} of the secondary."
        )
        doubts = [
            purpose_warning(self.rig, "matching"),
            *self._on_tables(by_camera),
            self.contradiction,
            self._on_few(pairs, min(one.rows, other.rows)),
            self._on_scatter(),
            self._on_names(reported),
        ]
        return Report(
            pairs,
            [chosen.sentence(), sentence],
            [*filter(None, doubts)],
            threshold_px=chosen.threshold_px,
            names=self.names,
        )

    def _on_few(self, pairs: int, most: int) -> str:
        """A note where few points, of at most so many, have a partner."""
        shares, noise = self.threshold.shares, self.threshold.noise
        is_forced = self.threshold.is_forced
        loses_many = is_forced and shares is not None and shares.lost > MANY_LOST
        if not loses_many and pairs >= FEW_MATCHED * most:
            return ""
        few = f"Few partners within {rounded(self.threshold.threshold_px, 3)} px."
        if noise is not None and is_forced and noise.source == "estimated":
            return (
                f"{few} Your points scatter by {noise.in_words}: have the threshold chosen from "
                "them."
            )
        return (
            f"{few} Make sure that points, parameters and the two cameras (primary, secondary)"
            " belong together; if your points are less exact than the targets, state their noise."
        )

    def _on_scatter(self) -> str:
        """A note on points that scatter by far more than the targets."""
        noise, targets = self.threshold.noise, noise_of_calibration(self.rig)
        if noise is None or noise.source != "estimated" or self.rig.purpose == "reconstruction":
            return ""
        if targets is not None and self.rig.is_repaired:
            return on_repaired(noise.sigma_px, targets.sigma_px)
        return on_far(noise.sigma_px, targets.sigma_px if targets else None)

    def _on_names(self, reported: pd.DataFrame) -> str:
        """A note on names whose points do not fit together, where that is more than noise."""
        if not self.names.columns:
            return ""
        pairs, shares = len(reported), self.threshold.shares
        above = Counter(texts(reported[~reported[WITHIN]], _named(self.names)))
        expected = USUAL_LOST if shares is None else shares.lost
        number = above.total()
        if number <= 3 + 3 * expected * pairs:
            return ""
        named = ", ".join(f"{name} {times} times" for name, times in above.most_common(3))
        return (
            f"{number} of {pairs} pairs of one name have errors above the threshold (column "
            f"{WITHIN}; {named}): these names may be of different points, or exchanged in a camera."
        )

    def _on_tables(self, by_camera: TablesByCamera) -> Iterator[str]:
        """Notes on frames and rows of the tables, and on images that look scaled down."""
        contents = list(by_camera.contents.values())
        for which, content, other in zip(CAMERAS, contents, contents[::-1], strict=True):
            label, left_out = by_camera.tables[which].label, by_camera.left_out
            alone = np.setdiff1d(content.frames, other.frames)
            if len(alone):
                shown = ", ".join(str(frame) for frame in alone[:3])
                yield (
                    f"{count(len(alone), 'frame', 'are')} in {label} only ({shown}"
                    f"{', ...' if len(alone) > 3 else ''}): points there have no partner."
                )
            yield left_out.get(which, "")
            width, height = getattr(self.rig, which).image_size
            u, v = content.largest
            if content.rows >= MANY_POINTS and u < width / 2 and v < height / 2:
                yield (
                    f"All points of {label} lie in the upper left quarter of the {which} "
                    f"camera's {width}x{height} px: were the images scaled down?"
                )


def names_and_threshold(
    rig: RigParameters, sample: Sample, distinct: Sequence[pd.DataFrame], stated: Stated
) -> tuple[Names, str, ThresholdChoice]:
    """The names that decide, a note on names that the images contradict, and the threshold.

    Args:
        sample: some of the frames that both cameras have.
        distinct: the different rows of the columns that may name points, in each table.
    """
    columns, is_forced = tuple(map(str, distinct[0])), stated.names != AUTO
    names, note = choose_names([TwoCameras(rig, sample)], distinct, columns, is_forced)
    if stated.sigma_px is None and stated.usual_px is not None:
        with suppress(StereocalError):  # they are too few
            choice = _threshold(rig, sample, names, stated)
            if choice.noise and choice.noise.source == "estimated":
                return names, note, choice
        stated = replace(stated, sigma_px=stated.usual_px)
    return names, note, _threshold(rig, sample, names, stated)


def _named(names: Names) -> list[str]:
    """The columns of pairs with the names of the primary's points."""
    return [f"{name}_primary" for name in names.columns]


def _threshold(rig: RigParameters, sample: Sample, names: Names, stated: Stated) -> ThresholdChoice:
    """The choice, with the noise by pairs of one name, and the threshold among all points.

    Beyond the threshold, points of other names fit as well, so a name may be wrong there.
    """
    named = [pixels for both in sample for pixels in names.samples(*both)]
    choice = choose_threshold(rig, named, stated.depths_m, stated.sigma_px, stated.threshold_px)
    if not names.columns or stated.threshold_px is not None or choice.noise is None:
        return choice
    with suppress(StereocalError):  # all points may be too dense for one
        every = [pixels for both in sample for pixels in NO_NAMES.samples(*both)]
        most = choose_threshold(rig, every, stated.depths_m, choice.noise.sigma_px).threshold_px
        chosen = min(most, choice.threshold_px)
        why = choice.chosen_for if choice.shares is None and chosen == choice.threshold_px else ""
        by_name = choose_threshold(rig, named, stated.depths_m, stated.sigma_px, chosen)
        return replace(by_name, is_forced=False, chosen_for=why)
    return choice
