"""Recognise unsupported files by their content, for helpful error messages."""

import re

from stereocal.errors import StereocalError
from stereocal.system.zip_files import is_zip, open_zip

HDF5 = b"\x89HDF\r\n\x1a\n"
DEEPLABCUT = b"df_with_missing"
"""Name of the table in DeepLabCut's HDF5 files."""
MATLAB = b"MATLAB "
WORKBOOK = b"xl/workbook.xml"
LISTED_AT_END = 1_000_000
"""Bytes at the end of a workbook that list its files."""
SECTION = re.compile(r"\[\s*([A-Za-z][^\[\]{}\"',]*)\]")
CAMERA_LISTS = {
    "COLMAP": re.compile(r"(?m)^\s*\d+ [A-Z_]{6,} \d+ \d+ [\d.]"),
    "Qualisys": re.compile(r"<calibration\b[^>]*>"),
}
OUR_JSON = (
    '{"K": [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], "distortion": [k1, k2, p1, p2, k3], '
    '"image_size": [width, height]}'
)
MATLAB_CAMERA = (
    's = struct("K", c.K - [0 0 1; 0 0 1; 0 0 0], "distortion", [c.RadialDistortion(1:2) '
    'c.TangentialDistortion c.RadialDistortion(3:end)], "distortion_model", "plumb_bob", '
    '"image_size", flip(c.ImageSize)); writelines(jsonencode(s), "camera.json")'
)


def is_hdf5(content: bytes) -> bool:
    return content.startswith(HDF5)


def is_workbook(content: bytes) -> bool:
    """Whether it is an Excel workbook, .xlsx: a zip with a file of that name, and no zip of one;
    also of a damaged one, whose reader says what is wrong."""
    if not is_zip(content) or WORKBOOK not in content[-LISTED_AT_END:]:
        return False
    try:
        with open_zip(content, "") as opened:
            return WORKBOOK.decode() in opened.names
    except StereocalError:
        return True


def is_matlab(content: bytes) -> bool:
    """Whether it is a .mat file; version 7.3 is HDF5 after a MATLAB header."""
    return content.startswith(MATLAB) and b"MAT-file" in content[:128]


def refuse_other_camera(content: bytes, source: str, may_be_toml: bool = False) -> None:
    """Reject a .mat or .ini file in place of a camera or parameters.

    Args:
        may_be_toml: accept TOML, which begins like an INI file.
    """
    if is_matlab(content):
        raise StereocalError(
            f"{source}: this is a MATLAB file (.mat), which is not read. For a camera, in MATLAB, "
            f"with c its cameraParameters: {MATLAB_CAMERA}"
        )
    section = None if may_be_toml else _ini_section(content)
    if section is not None:
        raise StereocalError(
            f"{source}: this is an INI file (its first section is [{section}]), which is not read. "
            f"Write the numbers of each camera into a JSON file: {OUR_JSON}"
        )


def no_table(content: bytes) -> str | None:
    """What a text is that is no table of points: COLMAP's or Qualisys's list of cameras, or XML."""
    text = content[:2000].decode("utf-8-sig", errors="replace")
    for program, pattern in CAMERA_LISTS.items():
        if pattern.search(text):
            return (
                f"this is a list of cameras of {program}, not a table of points, and its "
                f"lenses are not read here: write each lens into a JSON file, {OUR_JSON}"
            )
    return "this is XML or HTML, and no table of points" if text.lstrip().startswith("<") else None


def refuse_other_points(content: bytes, source: str) -> None:
    """Reject a MATLAB or DeepLabCut HDF5 file in place of points."""
    if is_matlab(content):
        raise StereocalError(
            f"{source}: this is a MATLAB file (.mat), which is not read as points: save the points "
            "as CSV (in easyWand and DLTdv: export)."
        )
    if is_hdf5(content) and DEEPLABCUT in content:
        raise StereocalError(
            f"{source}: this is an HDF5 file of DeepLabCut, which is not read because it may "
            "contain code that would be run. Use the CSV file that DeepLabCut writes beside it "
            "(save_as_csv=True, or deeplabcut.analyze_videos_converth5_to_csv)."
        )


def _ini_section(content: bytes) -> str | None:
    """The first section of an INI file; None for any other file."""
    text = content[:10_000].decode("utf-8-sig", errors="replace")
    for line in map(str.strip, text.splitlines()):
        if line and not line.startswith(("#", ";")):
            section = SECTION.fullmatch(line)
            return None if section is None else section[1].strip()[:40]
    return None
