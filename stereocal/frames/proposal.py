"""Pair the photographs of two cameras: by name, by the time taken, or in order, and why.

Names decide where they pair all, unless the cameras' own clocks contradict; then the times, where
one difference of the clocks fits clearly best; then names that pair most; then the order.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

from stereocal.calibration.offset_scan import FEWEST
from stereocal.frames.by_time import Alignment, Times, aligned_clocks, times_of
from stereocal.frames.conventions import (
    FOLDERS,
    NameReading,
    readings_by_divisions,
    readings_by_words,
)
from stereocal.frames.pairing import (
    Alone,
    ByHand,
    Moments,
    Pairing,
    best_reading,
    first_names,
    missing,
    natural,
    numbered,
    short_names,
)
from stereocal.frames.sides import Sides, sides_of
from stereocal.rig.camera import CAMERAS
from stereocal.system.numbers import count
from stereocal.system.taken import Source, Taken

Way = Literal["name", "time", "order", "motion"]
WAYS: tuple[Way, ...] = ("name", "time", "order", "motion")
LEAST_BY_NAME = 0.5
"""Share of the camera with fewer photographs that names must pair, to be gone by."""
CONTRADICTED = 2
"""Pairs of complete names that the times must contradict."""
SOURCES: dict[Source, str] = {
    "camera": "the time taken",
    "name": "the time in their names",
    "file": "the time of the files",
}


@dataclass(frozen=True)
class Choice:
    """What the user decided."""

    way: Way | None = None
    """None: as proposed."""
    without: tuple[str, ...] = ()
    """Photographs that are left out: they have no partner."""
    exchanged: bool = False
    """Whether the other camera is the primary."""
    heard: Mapping[str, float] = field(default_factory=dict)
    later: Mapping[str, int] | None = None
    """What is known of cameras started by hand: `heard` as in `ByHand` and, if the motion told
    it in the sentence `told`, `later` as in `Motion`."""
    told: str = ""


@dataclass(frozen=True)
class Proposal:
    """The ways to pair, and which one is taken."""

    ways: Mapping[Way, Pairing]
    """Those that pair any, in the order of `WAYS`."""
    best: Way
    """The one to propose."""
    way: Way
    """The one taken: as chosen, else the best."""
    slips: tuple[Alone, ...]
    """Photographs without a partner by the times, if these are sure."""
    named: Pairing
    """The pairing by name, with or without pairs."""

    @property
    def pairing(self) -> Pairing:
        """The pairing taken; without pairs if there is no way."""
        return self.ways.get(self.way, self.named)


def propose(taken: Mapping[str, Taken], choice: Choice = Choice()) -> Proposal:
    """Propose how photographs belong together.

    Args:
        taken: what each file says, by name, in the order given.
    """
    used = {name: one for name, one in taken.items() if name not in choice.without}
    names = sorted(used, key=natural)
    words = readings_by_words(names)
    readings = words, [_as_in(one, words) for one in readings_by_divisions([*used])]
    sides = sides_of(used, [*readings[0], *readings[1]])
    if choice.exchanged:
        readings = [one.exchanged() for one in readings[0]], [o.exchanged() for o in readings[1]]
        sides = sides and sides.exchanged()
    named = _by_name(names, *readings)
    ways: dict[Way, Pairing] = {"name": named} if named.pairs else {}
    sure = False
    if sides is not None:
        times = tuple(times_of(of_camera, used) for of_camera in sides.cameras)
        aligned = aligned_clocks(*times)
        if aligned is not None:
            ways["time"], sure = _by_time(sides, times, aligned), aligned.sure
        ways["order"] = _in_order(sides)
        if min(map(len, sides.cameras)) >= FEWEST:
            ways["motion"] = _by_motion(sides, choice)
    best = _best(ways, sure, sure and times[0].source == times[1].source == "camera")
    way = choice.way if choice.way in ways else best
    return Proposal(ways, best, way, ways["time"].alone if sure else (), named)


def _as_in(division: NameReading, words: Sequence[NameReading]) -> NameReading:
    """A division with the primary camera that words name, if they divide alike."""
    for reading in words:
        same = [
            reading.side_and_key.get(name, side_and_key)[0] == side_and_key[0]
            for name, side_and_key in division.side_and_key.items()
        ]
        if len(reading.side_and_key) == len(same):
            return division if any(same) else division.exchanged()
    return division


def _by_name(
    names: Sequence[str], words: Sequence[NameReading], divisions: Sequence[NameReading]
) -> Pairing:
    """The pairing by words and folders; else by two beginnings or numbers of names, if these pair
    all."""
    named = best_reading(names, [*words, *(one for one in divisions if one.rank <= FOLDERS)])
    rest = [one for one in divisions if one.rank > FOLDERS]
    if _mostly(named) or not rest:
        return named
    weak = best_reading(names, rest)
    return weak if weak.complete else named


def _mostly(named: Pairing) -> bool:
    """Whether names pair enough photographs to be gone by."""
    alone = [sum(one.camera == camera for one in named.alone) for camera in (0, 1)]
    return len(named.pairs) > 0 and len(named.pairs) >= LEAST_BY_NAME * (
        len(named.pairs) + min(alone)
    )


def _best(ways: Mapping[Way, Pairing], sure: bool, by_cameras: bool) -> Way:
    named, timed = ways.get("name"), ways.get("time")
    if named is not None and named.complete:
        partner = {} if timed is None else {p.primary: p.secondary for p in timed.pairs}
        against = sum(partner.get(p.primary, p.secondary) != p.secondary for p in named.pairs)
        return "time" if by_cameras and against >= CONTRADICTED else "name"
    if sure and timed is not None and len(timed.pairs) >= len(named.pairs if named else ()):
        return "time"
    return "name" if "order" not in ways or (named is not None and _mostly(named)) else "order"


def _by_time(sides: Sides, times: Sequence[Times], aligned: Alignment) -> Pairing:
    twos = [(times[0].names[i], times[1].names[j]) for i, j in aligned.pairs.tolist()]
    alone = tuple(_alone(sides, twos, {*times[0].names, *times[1].names}))
    what = SOURCES[max((clock.source for clock in times), key=[*SOURCES].index)]
    fine = max(clock.step for clock in times) < 1.0
    apart = duration(abs(aligned.clocks_s), fine)
    sentences = [
        f"{count(len(twos), 'pair')} by {what}; the clocks are {apart} apart.",
        *([] if aligned.sure else ["Another difference of the clocks fits nearly as well."]),
        *_about(sides, alone),
    ]
    return Pairing(_numbered(twos), alone, sides.unknown, " ".join(sentences), not aligned.sure)


def _in_order(sides: Sides) -> Pairing:
    first, second = sides.cameras
    twos = list(zip(first, second, strict=False))
    rest = first[len(second) :], second[len(first) :]
    alone = tuple(Alone(name, camera) for camera in (0, 1) for name in rest[camera])
    longer = int(len(second) > len(first))
    in_order = f"{count(len(twos), 'pair')} in order"
    if sides.equal:
        sentences = [f"{in_order}: both cameras have as many. Check that they agree."]
    else:
        sentences = [f"{in_order}, the first with the first."]
        more = len(alone)
        sentences.append(
            f"The {CAMERAS[longer]} camera has {count(more, 'photograph')} more than the "
            f"{CAMERAS[1 - longer]}; the names do not tell which {'has' if more == 1 else 'have'} "
            "no partner: look for the first wrong pair, or find the targets, which may tell."
        )
    sentences += _about(sides, ())
    return Pairing(_numbered(twos), alone, sides.unknown, " ".join(sentences), not sides.equal)


def _by_motion(sides: Sides, choice: Choice) -> Pairing:
    by_hand = by_hand_of(dict(zip(CAMERAS, sides.cameras, strict=True)), choice.heard)
    if choice.later is not None:
        moments = by_hand.moments(choice.later)
        return Pairing(moments, (), sides.unknown, choice.told, by_hand=by_hand)
    sentence = (
        "Cameras that were started by hand: which photographs belong together is found with the "
        "targets. Until then, the first with the first."
    )
    return replace(_in_order(sides), sentence=sentence, ambiguous=True, by_hand=by_hand)


def by_hand_of(folders: Mapping[str, Sequence[str]], heard: Mapping[str, float]) -> ByHand:
    """The photographs of cameras that were started by hand, by camera and in order."""
    counts = {
        camera: dict(zip(names, _numbers(names), strict=True)) for camera, names in folders.items()
    }
    return ByHand(counts, heard)


def _about(sides: Sides, alone: Sequence[Alone]) -> list[str]:
    """Whose photographs are whose, and which have no partner."""
    sentences = [sides.sentence, *missing(alone)]
    if sides.unknown:
        sentences.append(f"These are of neither camera: {first_names(sides.unknown)}.")
    return sentences


def _alone(
    sides: Sides, twos: Sequence[tuple[str, str]], timed: Collection[str]
) -> Iterator[Alone]:
    """The photographs without a partner, and after which of the other camera it is missing."""
    for camera, names in enumerate(sides.cameras):
        partner = {two[camera]: two[1 - camera] for two in twos}
        others = sides.cameras[1 - camera]
        short = dict(zip(others, short_names(others), strict=True))
        where = f"before {short[others[0]]}"
        for name in names:
            if name in partner:
                where = f"after {short[partner[name]]}"
            elif name not in timed:
                yield Alone(name, camera, where="its file does not say when it was taken")
            else:
                gap = f"one photograph is missing in the {CAMERAS[1 - camera]} {where}"
                yield Alone(name, camera, where=gap)


def _numbered(twos: Sequence[tuple[str, str]]) -> Moments:
    """Pairs in order, by the numbers of the primary's names."""
    frames = _numbers([primary for primary, _ in twos])
    return {k: dict(zip(CAMERAS, two, strict=True)) for k, two in zip(frames, twos, strict=True)}


def _numbers(names: Sequence[str]) -> Iterable[int]:
    """The numbers in the names if these rise, else from 1."""
    short = short_names(names)
    by_names = numbered(short)
    return by_names.values() if [*by_names] == short else range(1, len(names) + 1)


def duration(seconds: float, fine: bool) -> str:
    """A time in words: 12.4 s, 61 min 12 s, 2 h 3 min, 3 days."""
    if seconds < 600:
        return f"{seconds:.1f} s" if fine else f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    if minutes < 600:
        return f"{int(seconds // 60)} min {int(seconds % 60)} s"
    if minutes < 48 * 60:
        return f"{minutes // 60} h {minutes % 60} min"
    return f"{minutes / 1440:.0f} days"
