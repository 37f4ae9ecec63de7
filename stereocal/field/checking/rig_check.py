"""Which camera of a rig has moved: the pairs are checked, and their answers fused.

A camera that moved is in all pairs that changed. The answer is the smallest set of cameras that
explains every changed pair and contradicts no pair that is still the same; if several are as small,
it cannot be told which.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Any

from stereocal.errors import StereocalError
from stereocal.field.checking.check_words import sentence, to_json, what_changed
from stereocal.field.checking.findings import FOCAL_LEVEL, POSE_LEVEL, Recheck, Verdict
from stereocal.field.checking.fits import Smallest
from stereocal.field.checking.new_images import images_of_bars
from stereocal.field.checking.prior import prior_of
from stereocal.field.checking.recheck import recheck
from stereocal.network.pairs import pair_name
from stereocal.network.rig_file import RigFile
from stereocal.rig.recording import Pair, Recording
from stereocal.verdict.in_words import listed

RIG_CHECK_FORMAT = "stereocal-check-rig/1"


@dataclass(frozen=True, eq=False)
class RigCheck:
    """The answer of a check of all pairs."""

    cameras: tuple[str, ...]
    pairs: Mapping[Pair, Recheck]
    unchecked: Mapping[Pair, str]
    """Pairs that could not be checked, and why."""

    def verdict_of(self, pair: Pair) -> Verdict:
        """Of one pair; with many pairs a change must be surer, that no more are false alarms."""
        own = self.pairs[pair]
        surely = min(own.p_pose / POSE_LEVEL, own.p_focal / FOCAL_LEVEL) * len(self.pairs) < 1.0
        return "cannot tell" if own.changed and not surely else own.verdict

    def _with(self, verdict: Verdict) -> list[Pair]:
        return [pair for pair in self.pairs if self.verdict_of(pair) == verdict]

    @cached_property
    def explanations(self) -> tuple[tuple[str, ...], ...]:
        """The smallest sets of cameras that explain all changed pairs; one set if it is known."""
        moved, same = self._with("moved"), self._with("same")
        if not moved:
            return ((),)
        for contradicted in (False, True):  # if nothing explains all, a small change was missed
            for size in range(1, len(self.cameras)):
                found = tuple(
                    some
                    for some in combinations(self.cameras, size)
                    if all({*some} & {*pair} for pair in moved)
                    and (contradicted or not any({*some} & {*pair} for pair in same))
                )
                if found:
                    return found
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


def check_rig(rig: RigFile, recording: Recording, smallest: Smallest | None = None) -> RigCheck:
    """Check whether cameras have moved since a rig was calibrated, by new images of two or more."""
    pairs: dict[Pair, Recheck] = {}
    unchecked: dict[Pair, str] = {}
    for pair in combinations([name for name in rig.names if name in recording.cameras], 2):
        try:
            own = rig.pair(*pair)
            images = images_of_bars(recording.pair(*pair), own)
            pairs[pair] = recheck(prior_of(own), images, smallest)
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


def rig_sentence(check: RigCheck) -> str:
    """The answer: which camera has moved."""
    if check.verdict == "same":
        return f"Same: no camera has moved, of {listed(check.cameras)}."
    if check.verdict == "cannot tell":
        return "Cannot tell: no movement is seen, but it would not be found in all cameras."
    if check.moved:
        several = "s" * (len(check.moved) > 1)
        return f"Moved or refocused: the camera{several} {listed(check.moved)}."
    which = "; or ".join(listed(some) for some in check.explanations) or listed(check.cameras)
    return f"Moved or refocused, and it cannot be told which camera: {which}."


def rig_notes(check: RigCheck) -> list[str]:
    """What each pair says, and which could not be checked."""
    notes = [
        f"{pair_name(pair)}: {what_changed(own) if own.changed else sentence(own)}"
        for pair, own in check.pairs.items()
    ]
    if check.verdict == "moved":
        notes.append("Calibrate the rig again, with bars recorded since.")
    return notes + [f"{pair_name(p)} was not checked: {why}" for p, why in check.unchecked.items()]


def rig_to_json(check: RigCheck) -> dict[str, Any]:
    """The content of `check.json`."""
    return {
        "format": RIG_CHECK_FORMAT,
        "verdict": check.verdict,
        "reason": rig_sentence(check),
        "cameras_moved": list(check.moved),
        "explanations": [list(some) for some in check.explanations],
        "pairs": {
            pair_name(pair): {**to_json(own), "verdict_in_rig": check.verdict_of(pair)}
            for pair, own in check.pairs.items()
        },
        "not_checked": {pair_name(pair): why for pair, why in check.unchecked.items()},
    }
