"""Which camera of a rig has moved: the pairs are checked, and their answers fused.

A camera that moved is in all pairs that changed. The answer is the smallest set of cameras that
explains every changed pair and contradicts no pair that is still the same; if several are as small,
it cannot be told which.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import Any

from stereocal.errors import StereocalError
from stereocal.field.checking import check_words
from stereocal.field.checking.findings import FOCAL_LEVEL, POSE_LEVEL, Recheck, Verdict
from stereocal.field.checking.fits import Smallest
from stereocal.field.checking.new_images import images_of_bars
from stereocal.field.checking.prior import prior_of
from stereocal.field.checking.recheck import recheck
from stereocal.fit.rig_file import RigFile
from stereocal.fit.start.pairs import pair_name
from stereocal.rig.camera import camera_in_words
from stereocal.rig.field_of_view import beyond_in_words
from stereocal.rig.recording import CameraPair, Recording
from stereocal.verdict.in_words import listed

RIG_CHECK_FORMAT = "stereocal-check-rig/1"


@dataclass(frozen=True, eq=False)
class RigCheck:
    """The answer of a check of all pairs."""

    cameras: tuple[str, ...]
    pairs: Mapping[CameraPair, Recheck]
    unchecked: Mapping[CameraPair, str]
    """Pairs that could not be checked, and why."""

    def verdict_of(self, pair: CameraPair) -> Verdict:
        """A pair's verdict; with many pairs a change must be surer: no more false alarms."""
        check = self.pairs[pair]
        surely = min(check.p_pose / POSE_LEVEL, check.p_focal / FOCAL_LEVEL) * len(self.pairs) < 1.0
        return "cannot tell" if check.changed and not surely else check.verdict

    def _with(self, verdict: Verdict) -> list[CameraPair]:
        return [pair for pair in self.pairs if self.verdict_of(pair) == verdict]

    @cached_property
    def explanations(self) -> tuple[tuple[str, ...], ...]:
        """The smallest sets of cameras that explain all changed pairs; one set if it is known."""
        moved, same = self._with("moved"), self._with("same")
        if not moved:
            return ((),)
        for contradicted in (False, True):  # if nothing explains all, a small change was missed
            for size in range(1, len(self.cameras)):
                sets = tuple(
                    names
                    for names in combinations(self.cameras, size)
                    if all({*names} & {*pair} for pair in moved)
                    and (contradicted or not any({*names} & {*pair} for pair in same))
                )
                if sets:
                    return sets
        return ()

    @property
    def moved(self) -> tuple[str, ...]:
        """The cameras that have moved, or were refocused; empty if none, or if it is not known."""
        return self.explanations[0] if len(self.explanations) == 1 else ()

    @property
    def verdict(self) -> Verdict:
        """`same` if every camera is in a pair that would have shown a movement."""
        if self._with("moved"):
            return "moved"
        seen = {name for pair in self._with("same") for name in pair}
        return "same" if {*self.cameras} <= seen else "cannot tell"

    @property
    def sentence(self) -> str:
        """The answer: which camera has moved."""
        if self.verdict == "same":
            return f"Same: no camera has moved, of {listed(self.cameras)}."
        if self.verdict == "cannot tell":
            own = [check for check in self.pairs.values() if check.images.own]
            if own:
                return check_words.sentence(own[0])
            return "Cannot tell: no movement is seen, but it would not be found in all cameras."
        if self.moved:
            return f"Moved or refocused: {camera_in_words(*self.moved)}."
        which = "; or ".join(listed(names) for names in self.explanations) or listed(self.cameras)
        return f"Moved or refocused, and it cannot be told which camera: {which}."

    @property
    def notes(self) -> list[str]:
        """What each pair says of new images, and which could not be checked."""
        notes = [
            f"{pair_name(pair)}: "
            + (check_words.what_changed(check) if check.changed else check_words.sentence(check))
            for pair, check in self.pairs.items()
            if not check.images.own  # said once, by the sentence
        ]
        if self.verdict == "moved":
            notes.append("Calibrate the rig again, with bars recorded since.")
        beyond: dict[str, int] = {}
        for check in self.pairs.values():
            beyond.update(check.images.dataset.recording.beyond_view)
        notes += filter(None, [beyond_in_words(beyond)])
        unchecked = self.unchecked.items()
        return notes + [f"{pair_name(pair)} was not checked: {why}" for pair, why in unchecked]

    def to_json(self) -> dict[str, Any]:
        """The content of `check.json`."""
        return {
            "format": RIG_CHECK_FORMAT,
            "verdict": self.verdict,
            "reason": self.sentence,
            "cameras_moved": list(self.moved),
            "explanations": [list(names) for names in self.explanations],
            "pairs": {
                pair_name(pair): {
                    **check_words.to_json(check),
                    "verdict_in_rig": self.verdict_of(pair),
                }
                for pair, check in self.pairs.items()
            },
            "not_checked": {pair_name(pair): why for pair, why in self.unchecked.items()},
        }


def check_rig(rig: RigFile, recording: Recording, smallest: Smallest | None = None) -> RigCheck:
    """Check whether cameras have moved since a rig was calibrated, by new images of two or more."""
    pairs: dict[CameraPair, Recheck] = {}
    unchecked: dict[CameraPair, str] = {}
    is_own = rig.about.inputs.get("sha256") == recording.sha256
    for pair in combinations([name for name in rig.names if name in recording.cameras], 2):
        try:
            parameters = rig.pair(*pair)
            images = replace(images_of_bars(recording.pair(*pair), parameters), own=is_own)
            pairs[pair] = recheck(prior_of(parameters), images, smallest)
        except StereocalError as error:
            unchecked[pair] = str(error)
    if not pairs:
        cameras = f"It has the cameras {listed(list(recording.cameras))}."
        why = next(iter(unchecked.values()), cameras)
        raise StereocalError(
            f"{recording.name}: no pair of the rig's cameras {listed(rig.names)} can be checked. "
            f"{why}"
        )
    return RigCheck(tuple(dict.fromkeys(n for pair in pairs for n in pair)), pairs, unchecked)
