"""Which cameras of a file are the primary and the secondary: by name first, then in their order."""

from collections.abc import Sequence
from dataclasses import dataclass

from stereocal.errors import StereocalError
from stereocal.frames.which_camera import names_camera, plain_name

Wanted = tuple[str | int, str | int] | None


@dataclass(frozen=True)
class ChosenPair:
    """The two cameras that are taken of those in a file."""

    cameras: tuple[str, ...]
    pair: tuple[int, int]
    """Indices of the primary and the secondary."""
    by_user: bool

    @property
    def names(self) -> tuple[str, str]:
        return self.cameras[self.pair[0]], self.cameras[self.pair[1]]

    @property
    def words(self) -> str:
        """Which cameras are used, in words."""
        more = f" of {len(self.cameras)}" if len(self.cameras) > 2 else ""
        return f"cameras {self.names[0]} and {self.names[1]}{more}"

    @property
    def remarks(self) -> tuple[str, ...]:
        """A remark if two of more cameras were taken that nobody chose."""
        if len(self.cameras) <= 2 or self.by_user:
            return ()
        return (
            f"There are {len(self.cameras)} cameras ({', '.join(self.cameras)[:100]}); the first "
            "two were taken. Choose others with --cameras, as "
            f"--cameras {self.cameras[0]},{self.cameras[2]}.",
        )


def chosen_pair(
    cameras: Sequence[str], wanted: Wanted, source: str, also: Sequence[str] = ()
) -> ChosenPair:
    """The primary and the secondary among the cameras of a file.

    Args:
        wanted: names or numbers from 1 as a user writes them, or indices; None: the first two.
        also: other names of the cameras, in the same order.
    """
    names = tuple(cameras)
    if len(names) < 2:
        raise StereocalError(f"two cameras are expected; the file has {len(names)}.", source)
    if wanted is None:
        return ChosenPair(names, (0, 1), False)
    first, second = camera_indices(wanted, names, source, also)
    if first == second:
        raise StereocalError("primary and secondary are the same camera: choose two.", source)
    return ChosenPair(names, (first, second), True)


def has_cameras(cameras: Sequence[str], wanted: Sequence[str | int]) -> bool:
    """Whether the wanted cameras are in a file, by name or by number."""
    return any(_readings(wanted, cameras))


def camera_indices(
    wanted: Sequence[str | int], names: Sequence[str], source: str, also: Sequence[str] = ()
) -> list[int]:
    """The indices of cameras that are wanted as in `chosen_pair`.

    Raises:
        StereocalError: a camera is not there, or names and numbers say different cameras.
    """
    by_name, by_number = _readings(wanted, names, also)
    words = [str(camera) for camera in wanted]
    if by_name and by_number and by_name != by_number:
        called, counted = [names[k] for k in by_name], [names[k] for k in by_number]
        raise StereocalError(
            f"{','.join(words)} can mean the cameras that are called so "
            f"({', '.join(called)}), or those with these numbers, counted from 1 "
            f"({', '.join(counted)}): write {_called(called)} or {_called(counted)}.",
            source,
        )
    if not (indices := by_name or by_number):
        unknown = [word for word in words if not any(_readings([word], names))]
        raise StereocalError(
            f"there is no camera {' or '.join(unknown or words)}; the file has {len(names)}, "
            f"counted from 1 ({', '.join(names)[:200]}).",
            source,
        )
    return indices


def _readings(
    wanted: Sequence[str | int], names: Sequence[str], also: Sequence[str] = ()
) -> tuple[list[int], list[int]]:
    """The indices of cameras by name, and by number; empty where one is not there."""
    words = [camera for camera in wanted if isinstance(camera, str)]
    if len(words) < len(wanted):
        return [], [camera for camera in wanted if isinstance(camera, int)]
    numbers = [int(word) - 1 for word in words if word.isdecimal() and len(word) < 9]
    known = len(numbers) == len(words) and all(0 <= index < len(names) for index in numbers)
    return namesakes(words, names) or namesakes(words, also), numbers if known else []


def namesakes(wanted: Sequence[str], names: Sequence[str]) -> list[int]:
    """The indices of cameras by name: as written, else but for `cam` and zeros before a number,
    else where one name is a word of the other, as `left` of `calib_left`.

    Empty if one of them has no namesake, or two have one.
    """
    for of in (str, plain_name):
        known = {of(name): k for k, name in enumerate(names)}
        indices = [known[of(camera)] for camera in wanted if of(camera) in known]
        if len(known) == len(names) and len({*indices}) == len(wanted):
            return indices
    hits = [[k for k, name in enumerate(names) if _is_named(camera, name)] for camera in wanted]
    indices = [hit[0] for hit in hits if len(hit) == 1]
    return indices if len({*indices}) == len(wanted) else []


def _is_named(first: str, other: str) -> bool:
    word, text = sorted((first.lower(), other.lower()), key=len)
    return names_camera(text, word)


def _called(names: Sequence[str]) -> str:
    """The names so that none is a number."""
    return ",".join(f"cam{name}" if name.isdecimal() else name for name in names)
