"""Why frames are doubtful or refused: what several of them share is said once."""

import re
from collections.abc import Mapping

from stereocal.rig.camera import CAMERAS
from stereocal.system.numbers import count

_BETWEEN = re.compile(r"(?<=[.?])\s+(?=[A-Z])")
_CAMERA = re.compile(r"^(?:In the )?(?:primary|secondary): ", re.IGNORECASE)
_PLACE = re.compile(r"The (\w+) at \(-?\d+, -?\d+\)")
LISTED = 12
"""Numbers of frames in a sentence."""


def shared_reasons(reasons: Mapping[int, str]) -> tuple[list[str], dict[int, str]]:
    """What several frames share, without cameras, places and what was measured, which stand after a
    colon.

    Args:
        reasons: of each frame, as sentences; empty if there are none.

    Returns:
        A sentence for each shared reason, that of the most frames first; and what else there is to
        say of each frame.
    """
    sentences = {frame: _BETWEEN.split(reason) for frame, reason in reasons.items() if reason}
    frames: dict[str, dict[int, None]] = {}
    for frame, said in sentences.items():
        for sentence in said:
            frames.setdefault(_gist(sentence), {})[frame] = None
    shared = {gist: [*numbers] for gist, numbers in frames.items() if len(numbers) > 1}
    rest = {
        frame: " ".join(sentence for sentence in said if _gist(sentence) not in shared)
        for frame, said in sentences.items()
    }
    by_number = sorted(shared.items(), key=lambda item: -len(item[1]))
    return [_in_words(gist, numbers) for gist, numbers in by_number], rest


def without_names(why: str, names: tuple[str, str]) -> str:
    """Sentences that name the cameras, of the reasons of two photographs, `1.png: no board; ...`,
    whose names no other frame shares.

    Args:
        names: of the primary's and the secondary's photograph.
    """
    camera = {name: which.capitalize() for name, which in zip(names, CAMERAS, strict=True)}
    parts = [part.partition(": ") for part in why.split("; ")]
    return ". ".join(camera.get(name, name) + colon + rest for name, colon, rest in parts)


def _gist(sentence: str) -> str:
    """`a target is blurred` of `In the primary: The target at (9, 5) is blurred: by 3 px.`"""
    return _PLACE.sub(r"a \1", _CAMERA.sub("", sentence)).partition(": ")[0].rstrip(".?")


def _in_words(gist: str, frames: list[int]) -> str:
    numbers = ", ".join(map(str, sorted(frames)[:LISTED]))
    more = f" and {len(frames) - LISTED} more" if len(frames) > LISTED else ""
    # The name of a target stays a capital.
    small = gist[:1].lower() if gist[1:2].islower() else gist[:1]
    return f"{count(len(frames), 'frame')}: {small}{gist[1:]}. Frames {numbers}{more}."
