"""What is this file? By its content first, by the ending of its name second."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Literal

from stereocal.errors import StereocalError
from stereocal.formats.dataset_description import DESCRIPTION
from stereocal.formats.exchange.exchange import READ, format_of, our_word
from stereocal.formats.file_storage import LARGEST_BYTES
from stereocal.formats.other_files import is_hdf5, is_matlab, is_workbook, no_table
from stereocal.formats.point_layouts import first_rows
from stereocal.frames.video.decoding import SUFFIXES as VIDEO_SUFFIXES
from stereocal.system.photograph import SUFFIXES as PHOTOGRAPH_SUFFIXES
from stereocal.system.zip_files import is_npz

Kind = Literal["photograph", "video", "zip", "table", "camera", "cameras", "rig", "data set"]
TABLE_SUFFIXES = (".csv", ".txt", ".tsv", ".h5", ".hdf5", ".xlsx")
CAMERA_SUFFIXES = (
    *(".json", ".yaml", ".yml", ".xml", ".toml", ".m", ".mat", ".ini", ".conf"),
    *(".cameramodel", ".xcp", ".npz"),
)
ACCEPTED = (
    "expected are photographs (PNG, JPEG, TIFF, BMP, PGM), videos (MP4, MOV, AVI, MKV), camera "
    "files, a table of points (CSV, XLSX), or a zip of them"
)
_AS_JPEG = "save it as JPEG or PNG in its full size"
_UNPACK = "unpack it, and give its files or a zip of them"
BEGINNINGS: Mapping[bytes, Kind] = {
    b"\x89PNG\r\n\x1a\n": "photograph",
    b"\xff\xd8\xff": "photograph",
    b"II*\0": "photograph",
    b"MM\0*": "photograph",
    **{b"P%d%c" % (n, end): "photograph" for n in range(1, 7) for end in b"\n\r \t#"},
    b"\x1aE\xdf\xa3": "video",
    b"PK\x03\x04": "zip",
    b"PK\x05\x06": "zip",
}
UNUSABLE_BEGINNINGS: Mapping[bytes, str] = {
    b"GIF8": f"this is a GIF: {_AS_JPEG}",
    b"8BPS": f"this is a Photoshop file: {_AS_JPEG}",
    b"%PDF": "this is a PDF: give the photographs, tables or camera files themselves",
    b"PAR1": "this is a Parquet table: save it as CSV",
    b"Rar!": f"this is a RAR archive: {_UNPACK}",
    b"7z\xbc\xaf'\x1c": f"this is a 7z archive: {_UNPACK}",
    b"\x1f\x8b": f"this is a gzip archive: {_UNPACK}",
    b"0&\xb2u\x8ef\xcf\x11": "this is a WMV video: convert it to MP4",
    b"FLV\x01": "this is an FLV video: convert it to MP4",
    b"\0\0\x01\xba": "this is an MPEG video: convert it to MP4",
    b"\xd0\xcf\x11\xe0": "this is an old Office document: save a table as CSV or XLSX",
}
RAW_SUFFIXES = (
    *(".arw", ".cr2", ".cr3", ".crw", ".dng", ".nef", ".nrw", ".orf", ".pef", ".raf", ".rw2"),
    *(".raw", ".srw", ".x3f"),
)
OURS: Mapping[str, Kind] = {"dataset": "data set", "camera": "camera", "rig": "rig"}
"""Our JSON files, by the word in their "format"; `parameters` have both cameras."""
OTHERS_OF_OURS = {
    "plan": "this is a plan: open it on the page Plan",
    "project": "this belongs to a project's zip: open the zip on the page Start",
    "world": "this is a world frame: give it on the page Apply",
}


@dataclass(frozen=True)
class Recognised:
    """What a file is; None: nobody can use it here, and `problem` says why and what to do."""

    kind: Kind | None
    problem: str = ""


def recognise(name: str, content: bytes) -> Recognised:
    """What a file is. A damaged file is what its name says: its reader names what is wrong.

    Args:
        name: with or without folders.
        content: whole; of photographs and videos the first bytes are looked at.
    """
    suffix = PurePosixPath(name.lower()).suffix
    if not content:
        return Recognised(None, "the file is empty (0 bytes): copy it again.")
    if suffix in RAW_SUFFIXES:
        return Recognised(
            None, "this is a raw photograph: export it as TIFF or JPEG, without lens correction."
        )
    if is_workbook(content):
        return Recognised("table")
    if (problem := _unusable(content)) is not None:
        return Recognised(None, f"{problem}.")
    if (ours := our_word(content)) in OTHERS_OF_OURS:
        return Recognised(None, f"{OTHERS_OF_OURS[ours]}.")
    kind = _by_beginning(content) or OURS.get(ours)
    kind = kind or _by_text(name, content) or _by_suffix(name, suffix)
    if kind == "table" and (problem := no_table(content)) is not None:
        return Recognised(None, f"{problem}.")
    return Recognised(kind) if kind else Recognised(None, f"the file is not known; {ACCEPTED}.")


def _unusable(content: bytes) -> str | None:
    """What to do with a file of a known kind that is not read."""
    for start, problem in UNUSABLE_BEGINNINGS.items():
        if content.startswith(start):
            return problem
    if content[4:8] == b"ftyp" and content[8:12] in (b"heic", b"heix", b"mif1", b"msf1", b"avif"):
        return f"this is a HEIC or AVIF photograph: {_AS_JPEG}"
    if content[:4] == b"RIFF" and content[8:12] == b"WEBP":
        return f"this is a WebP photograph: {_AS_JPEG}"
    if content.startswith(b"PK") and b"[Content_Types].xml" in content[:2000]:
        return "this is an Office document: save a table as CSV or XLSX"
    return None


def _by_beginning(content: bytes) -> Kind | None:
    if is_npz(content):
        return None
    for start, kind in BEGINNINGS.items():
        if content.startswith(start):
            return kind
    if content[:2] == b"BM" and content[6:10] == bytes(4):
        return "photograph"
    if content[4:8] in (b"ftyp", b"moov", b"mdat", b"wide"):
        return "video"
    return "video" if content[:4] == b"RIFF" and content[8:11] == b"AVI" else None


def _by_text(name: str, content: bytes) -> Kind | None:
    """The kind of a text, MATLAB or HDF5 file."""
    if is_matlab(content):
        return "cameras"
    if is_hdf5(content):  # as MATLAB saves too
        return "cameras" if name.lower().endswith(".mat") else "table"
    return _cameras(name, content) or ("table" if _is_table(name, content) else None)


def _cameras(name: str, content: bytes) -> Kind | None:
    if len(content) > LARGEST_BYTES:
        return None
    try:
        key = format_of(name, content)
    except StereocalError:  # damaged: its reader says what is wrong
        return None
    return None if key is None else "camera" if READ[key].one_camera else "cameras"


def _is_table(name: str, content: bytes) -> bool:
    """Whether a text has rows of two cells or more."""
    if name.lower().endswith(CAMERA_SUFFIXES):
        return False
    try:
        rows, _ = first_rows(content, name)
    except StereocalError:
        return False
    return len(rows[0]) > 1 and len(rows[1]) > 1


def _by_suffix(name: str, suffix: str) -> Kind | None:
    if PurePosixPath(name).name == DESCRIPTION:
        return "data set"
    kinds: tuple[tuple[Kind, tuple[str, ...] | frozenset[str]], ...] = (
        ("photograph", PHOTOGRAPH_SUFFIXES),
        ("video", VIDEO_SUFFIXES),
        ("table", TABLE_SUFFIXES),
        ("camera", CAMERA_SUFFIXES),
        ("zip", (".zip",)),
    )
    return next((kind for kind, known in kinds if suffix in known), None)
