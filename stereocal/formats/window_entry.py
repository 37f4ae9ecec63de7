"""The entry "window" of `dataset.json`: what is stated of the windows that cameras look through."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from stereocal.errors import StereocalError, naming
from stereocal.rig.camera import Camera
from stereocal.rig.recording import Recording
from stereocal.rig.window import StatedWindow, check_windows
from stereocal.system.records import settings_of

WINDOW = "window"
AIR = 1.0
HOW = (
    f'Write "{WINDOW}": {{"thickness_m": 0.01, "glass": 1.52, "medium": 1.333}}, in metres, or a '
    'list of these with "cameras" in each.'
)


def windows_in(stated: Any, cameras: Mapping[str, Camera]) -> tuple[StatedWindow, ...]:
    """The windows that an entry states; none of those into air.

    Args:
        stated: an object, of all cameras where it names none, or a list of them.
    """
    if stated is None:
        return ()
    several = isinstance(stated, list)
    entries = stated if several else [stated]
    windows = []
    for number, entry in enumerate(entries, 1):
        with naming(f'"{WINDOW}", entry {number}' if several else f'"{WINDOW}"'):
            windows.append(_window_of(entry, () if len(entries) > 1 else tuple(cameras)))
    through = tuple(window for window in windows if window.medium != AIR)
    check_windows(through, cameras)
    for name in (name for window in through for name in window.cameras):
        if cameras[name].window is not None:
            raise StereocalError(
                f'the file of the camera {name} has a window already: remove it there, or in "'
                f'{WINDOW}".'
            )
    return through


def _window_of(entry: Any, every: Sequence[str]) -> StatedWindow:
    """A window; of `every` camera if it names none."""
    if not isinstance(entry, Mapping):
        raise StereocalError(f"it must be an object. {HOW}")
    if not every and "cameras" not in entry:
        raise StereocalError('each of several must name its "cameras", as "cameras": ["left"].')
    try:
        return settings_of({"cameras": [*every], **entry}, StatedWindow, "window")
    except StereocalError as error:
        if isinstance(error.__cause__, ValueError):  # of its form, not of a value
            raise StereocalError(f"{error} {HOW}") from error
        raise


def window_entries(recording: Recording, names: Sequence[str] = ()) -> list[dict[str, Any]]:
    """The inverse of `windows_in`, of a list.

    Args:
        names: what the file calls the cameras, in their order; empty: as the recording does.
    """
    named = dict(zip(recording.cameras, names or recording.cameras, strict=True))
    return [
        replace(window, cameras=tuple(named[name] for name in window.cameras)).to_json()
        for window in recording.windows
    ]


def windows_entry(
    recording: Recording, names: Sequence[str] = ()
) -> dict[str, Any] | list[dict[str, Any]] | None:
    """The entry of `dataset.json`: of one window an object; None without windows."""
    entries = window_entries(recording, names)
    return entries[0] if len(entries) == 1 else entries or None
