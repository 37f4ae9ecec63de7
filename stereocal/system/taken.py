"""When a photograph was taken, and with which camera, as its file says.

By the camera's own clock (EXIF), else by the time in the file's name, as phones and recorders write
it, else by the file's own time.
"""

import io
import re
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path, PurePosixPath
from typing import Any, Literal

from PIL import Image

from stereocal.system.photograph import FORMATS

Source = Literal["camera", "name", "file", ""]
EXIF, MODEL, MAKE = 0x8769, 0x0110, 0x010F
BODY_SERIAL, CAMERA_SERIAL = 0xA431, 0xC62F
DATES = ((0x9003, 0x9291, 0x9011), (0x9004, 0x9292, 0x9012), (0x0132, 0x9290, 0x9010))
"""EXIF tags of a date, its fraction of a second and its time zone: original, digitized, changed."""
LONGEST_FRACTION = 9
IN_A_NAME = re.compile(
    r"(?<!\d)((?:19|20)\d\d)[-_.]?([01]\d)[-_.]?([0-3]\d)[-_ tT.]{0,3}"
    r"([0-2]\d)[-_.:hH]?([0-5]\d)[-_.:mM]?([0-5]\d)(?:\.?(\d{3}|\d{6}))?(?!\d)"
)
EPOCH_IN_A_NAME = re.compile(r"(?<!\d)(1\d{9})(?:\.?(\d{1,9}))?(?!\d)")
"""Seconds since 1970, then a fraction, as in 1403636579763555584.png."""
FILE_STEP = 2.0
"""Resolution in s of the times of files: that of zips and memory cards."""


@dataclass(frozen=True)
class Taken:
    """What a photograph's file says about the moment and the camera."""

    seconds: float | None = None
    """Since 1970 by the clock of the source, in local time; None if nothing says it."""
    step: float = 1.0
    """Resolution of `seconds`."""
    source: Source = ""
    zone: float | None = None
    """How far the clock is ahead of UTC, in s; None if not said."""
    body: str = ""
    """Maker, model and serial number of the camera."""
    size: tuple[int, int] | None = None
    """Width and height, px."""


def read_taken(file: Path | bytes, name: str, modified: float | None = None) -> Taken:
    """What a photograph's header, its name and its file's time say.

    Nothing is raised: a file that cannot be read says nothing here.

    Args:
        modified: the file's own time, in s since 1970.
    """
    header = _header(file)
    exif = _exif_time(header.get("exif", {}))
    body, size = header.get("body", ""), header.get("size")
    if exif is not None:
        seconds, fine, zone = exif
        return Taken(seconds, fine, "camera", zone, body, size)
    if (named := time_in_name(name)) is not None:
        return Taken(*named, "name", None, body, size)
    if modified is not None:
        return Taken(modified, FILE_STEP, "file", None, body, size)
    return Taken(body=body, size=size)


def time_in_name(name: str) -> tuple[float, float] | None:
    """The time in a file's name, in s since 1970, and its resolution; None if there is none."""
    stem = PurePosixPath(name.replace("\\", "/")).stem
    if (match := IN_A_NAME.search(stem)) is not None:
        try:
            moment = datetime.strptime(" ".join(match.groups()[:6]), "%Y %m %d %H %M %S")
        except ValueError:
            return None
        moment = moment.replace(tzinfo=UTC)
        return _with_fraction(moment.timestamp(), match[7] or "")
    if (match := EPOCH_IN_A_NAME.search(stem)) is not None:
        return _with_fraction(float(match[1]), match[2] or "")
    return None


def _with_fraction(seconds: float, digits: str) -> tuple[float, float]:
    """A time with the decimal digits of its second, and its resolution."""
    digits = digits[:LONGEST_FRACTION]
    return (seconds + float(f"0.{digits}"), 10.0 ** -len(digits)) if digits else (seconds, 1.0)


def _header(file: Path | bytes) -> dict[str, Any]:
    """Tags, camera and size of an image, without decoding it."""
    try:
        # Pillow decodes a whole PNG to learn that it has no EXIF.
        with Image.open(io.BytesIO(file) if isinstance(file, bytes) else file, formats=FORMATS) as (
            image
        ):
            header: dict[str, Any] = {"size": image.size}
            if image.format == "PNG" and b"eXIf" not in (
                file if isinstance(file, bytes) else file.read_bytes()
            ):
                return header
            tags = image.getexif()
            exif = tags.get_ifd(EXIF)
            header["exif"] = {**tags, **exif}
            serial = exif.get(BODY_SERIAL) or tags.get(CAMERA_SERIAL)
            camera_tags = (tags.get(MAKE), tags.get(MODEL), serial)
            header["body"] = " ".join(text for tag in camera_tags if (text := _text(tag)))
            return header
    except Exception:  # Pillow's parsers may raise anything
        return {}


def _exif_time(tags: Mapping[int, Any]) -> tuple[float, float, float | None] | None:
    """Seconds, resolution and time zone of the first date that is one."""
    for date, fraction, zone in DATES:
        try:
            moment = datetime.strptime(_text(tags.get(date))[:19], "%Y:%m:%d %H:%M:%S")
        except ValueError:
            continue
        digits = re.match(r"\d*", _text(tags.get(fraction)))
        seconds = moment.replace(tzinfo=UTC).timestamp()
        seconds, step = _with_fraction(seconds, digits[0] if digits else "")
        return seconds, step, _zone(_text(tags.get(zone)))
    return None


def _zone(text: str) -> float | None:
    """Seconds ahead of UTC in "+02:00"."""
    match = re.fullmatch(r"([+-])(\d\d):?(\d\d)", text)
    if match is None:
        return None
    ahead = timedelta(hours=int(match[2]), minutes=int(match[3])).total_seconds()
    return -ahead if match[1] == "-" else ahead


def _text(value: Any) -> str:
    if isinstance(value, bytes):
        value = value.decode("ascii", "ignore")
    return "" if value is None else str(value).strip("\0 ")


def when_taken(photographs: Mapping[str, Path]) -> dict[str, Taken]:
    """When each photograph was taken, by its header, its name or its file's time."""
    times = {}
    for name, path in photographs.items():
        try:
            modified = path.stat().st_mtime
        except OSError:  # reported where the photograph is read
            modified = None
        times[name] = read_taken(path, name, modified)
    return times
