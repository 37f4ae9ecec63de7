"""Photographs as files, folders, zips and uploads: what is read, and what is refused."""

import struct
import zipfile
from io import BytesIO
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image as PillowImage

from stereocal.system.photograph import photograph_size, read_photograph
from stereocal.system.photograph_files import photographs_in, unpack_photographs
from tests.files import chunks_of, encoded, png_of, write, zipped
from tests.refused import refused

Image = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]
WIDTH, HEIGHT = 61, 43


def picture(dtype: type = np.uint8, channels: int = 1, highest: int = 255) -> Image:
    shape = (HEIGHT, WIDTH) if channels == 1 else (HEIGHT, WIDTH, channels)
    return np.random.default_rng(5).integers(0, highest + 1, shape).astype(dtype)


def exif(orientation: int) -> bytes:
    """A TIFF directory with nothing but an orientation, as cameras put it into a JPEG."""
    return b"MM\0*\0\0\0\x08" + struct.pack(">HHHIHHI", 1, 0x112, 3, 1, orientation, 0, 0)


def with_orientation(jpeg: bytes, orientation: int) -> bytes:
    segment = b"Exif\0\0" + exif(orientation)
    return jpeg[:2] + b"\xff\xe1" + struct.pack(">H", len(segment) + 2) + segment + jpeg[2:]


def tiff(dtype: str = "uint8", pages: int = 1, kind: int = 1) -> bytes:
    """A grey TIFF of 32 x 20 px; `kind` is its SampleFormat."""
    images = [PillowImage.fromarray(np.zeros((20, 32), dtype)) for _ in range(pages)]
    out = BytesIO()
    told = {} if kind == 1 else {339: kind}
    images[0].save(out, "TIFF", save_all=True, append_images=images[1:], tiffinfo=told)
    return out.getvalue()


@pytest.mark.parametrize("suffix", [".png", ".tiff", ".bmp", ".pgm"])
def test_grey_of_8_bits_comes_back_bit_for_bit(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"a{suffix}"
    path.write_bytes(encoded(picture(), suffix))
    read = read_photograph(path)
    assert read.dtype == np.uint8
    assert np.array_equal(read, picture())
    assert photograph_size(path) == (WIDTH, HEIGHT)


@pytest.mark.parametrize("highest", [1023, 4095, 65535])
@pytest.mark.parametrize("suffix", [".png", ".tiff", ".pgm"])
def test_10_12_and_16_bits_stay_raw(suffix: str, highest: int) -> None:
    image = picture(np.uint16, highest=highest)
    read = read_photograph(encoded(image, suffix), "a")
    assert read.dtype == np.uint16
    assert np.array_equal(read, image)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize(("suffix", "channels"), [(".png", 3), (".png", 4), (".tiff", 3)])
def test_colours_become_grey_by_weights(dtype: type, suffix: str, channels: int) -> None:
    image = picture(dtype, channels, int(np.iinfo(dtype).max))
    read = read_photograph(encoded(image, suffix), "a")
    assert read.dtype == dtype
    expected = image[:, :, :3] @ np.array([0.114, 0.587, 0.299])
    # Half a unit of rounding; OpenCV's weights have 14 bits, which is 0.8 of 65535. Measured 1.4.
    assert np.abs(read - expected).max() < (0.6 if dtype == np.uint8 else 3.0)


def test_jpeg_is_near_what_went_in() -> None:
    flat = np.full((HEIGHT, WIDTH), 100, np.uint8)
    for image in (flat, np.dstack([flat] * 3)):
        assert np.abs(read_photograph(encoded(image, ".jpg"), "a").astype(int) - 100).max() <= 1


@pytest.mark.parametrize("orientation", range(1, 9))
def test_orientation_is_never_applied(orientation: int) -> None:
    plain = encoded(picture(), ".jpg")
    turned = with_orientation(plain, orientation)
    assert np.array_equal(read_photograph(turned, "a"), read_photograph(plain, "a"))
    chunks = chunks_of(encoded(picture(), ".png"))
    png = png_of([chunks[0], (b"eXIf", exif(orientation)), *chunks[1:]])
    assert np.array_equal(read_photograph(png, "a"), picture())
    assert photograph_size(turned) == photograph_size(png) == (WIDTH, HEIGHT)


def test_a_jpeg_with_a_preview_after_it_is_read_and_a_preview_does_not_hide_a_cut() -> None:
    """MPO, and EXIF with a thumbnail, which ends as the whole does."""
    plain = encoded(picture(), ".jpg")
    thumbnail = b"\xff\xe1" + struct.pack(">H", len(JPEG) + 8) + b"Exif\0\0" + JPEG
    whole = plain[:2] + thumbnail + plain[2:] + JPEG
    assert np.array_equal(read_photograph(whole, "a"), read_photograph(plain, "a"))
    with refused("JPEG"):
        read_photograph(plain[:2] + thumbnail + plain[2:-200], "a")


PNG, JPEG = encoded(picture(), ".png"), encoded(picture(), ".jpg")
FIRST, *REST = chunks_of(PNG)
SIDES = 60_000, 60_000
HUGE = struct.pack(">IIBBBBB", *SIDES, 8, 0, 0, 0, 0)
HUGE_BMP = b"BM" + bytes(12) + struct.pack("<IiiHHI", 40, *SIDES, 1, 8, 1) + bytes(20)
FRAME = JPEG.index(b"\xff\xc0")


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "0 bytes"),
        (b"frame,target\n1,A\n", "photograph"),
        (PNG[: len(PNG) // 2], "cut off"),
        (PNG[:200] + bytes([PNG[200] ^ 1]) + PNG[201:], "damaged"),
        (JPEG[:-2], "JPEG"),
        (JPEG[: FRAME + 4] + b"\x0c" + JPEG[FRAME + 5 :], "TIFF, BMP or PGM of 8 or 16 bits"),
        (encoded(picture(), ".bmp")[:-9], "BMP"),
        (b"P5\n61 43 70000\n", "damaged"),
        (b"P2\n61 43 255\n1 2 3", "PGM"),
        (tiff()[:-9], "TIFF"),
        (tiff("float32"), "32 bits"),
        (tiff("uint16", kind=2), "16 bits"),
        (tiff(pages=3), "TIFF"),
        (png_of([(b"IHDR", HUGE), (b"IDAT", b""), (b"IEND", b"")]), "60000x60000 px"),
        (b"P2 60000 60000 255", "60000x60000 px"),
        (HUGE_BMP, "60000x60000 px"),
        (JPEG[: FRAME + 5] + struct.pack(">HH", *SIDES) + JPEG[FRAME + 9 :], "60000x60000 px"),
        (encoded(picture()[:4, :4], ".png"), "4x4 px"),
        (png_of([FIRST, (b"acTL", struct.pack(">II", 2, 0)), *REST]), "animated"),
    ],
)
def test_what_cannot_be_used_is_said(content: bytes, said: str) -> None:
    with refused("left 7.png: ", said):
        read_photograph(content, "left 7.png")


def png(seed: int) -> bytes:
    return encoded(np.random.default_rng(seed).integers(0, 256, (30, 40), np.uint8))


FOUND = ["rig/cam0/1.png", "rig/cam1/1.PNG"]
FILES = {FOUND[0]: png(1), FOUND[1]: png(2), "rig/notes.txt": b"windy"}
FILES |= {"__MACOSX/rig/cam0/._1.png": b"\0\5\x16\7", "rig/.hidden.png": b"x"}


def test_folder(tmp_path: Path) -> None:
    write(FILES, tmp_path)
    found = photographs_in(tmp_path, tmp_path / "unused")
    assert sorted(found) == FOUND
    assert found[FOUND[0]] == tmp_path / FOUND[0]
    assert not (tmp_path / "unused").exists()


def test_zip(tmp_path: Path) -> None:
    (tmp_path / "a.zip").write_bytes(zipped(FILES))
    seen = []
    found = photographs_in(tmp_path / "a.zip", tmp_path / "in", lambda *at: seen.append(at))
    assert sorted(found) == FOUND
    assert seen == [(1, 2), (2, 2)]
    assert found[FOUND[1]].read_bytes() == FILES[FOUND[1]]
    assert read_photograph(found[FOUND[0]]).shape == (30, 40)


@pytest.mark.parametrize(
    "name", ["../out.png", "/tmp/out.png", "C:\\out.png", "a/../../out.png", "nul.png", "x" * 300]
)
def test_no_path_of_a_zip_is_written_to(name: str, tmp_path: Path) -> None:
    name = name if name.endswith(".png") else name + ".png"
    content = zipped({name: png(1)}, zipfile.ZIP_STORED)
    found = unpack_photographs(content, "a.zip", tmp_path / "deep" / "in")
    assert all(path.parent == tmp_path / "deep" / "in" for path in found.values())
    assert len(found) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["deep"]
    assert [path.name for path in (tmp_path / "deep").iterdir()] == ["in"]
