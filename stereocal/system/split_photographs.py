"""Photographs that hold the images of two cameras, side by side or one above the other."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Literal, TypeVar, get_args

import cv2

from stereocal.errors import StereocalError
from stereocal.system.atomic_files import write_atomically
from stereocal.system.photograph import GreyImage, PhotographFile, read_colours

F = TypeVar("F")
Split = Literal["side-by-side", "top-bottom"]
SPLITS: tuple[Split, ...] = get_args(Split)
"""In the order of x and y."""
FOLDERS = ("left", "right")
"""Names of the two cameras: the left or upper image is the first's."""
LEAST_LONGER = 1.9, 1.05
"""Two images side by side are at least so many times as wide as high, and two above each other as
high as wide: of square images 2, of 16:9 1.125. Photographs of one camera are seldom like the
first; those held upright are like the second."""


def split_by_shape(size: tuple[int, int]) -> Split | None:
    """How two images may lie in a photograph of this width and height; None if hardly."""
    width, height = size
    wide, high = LEAST_LONGER
    return SPLITS[0] if width >= wide * height else SPLITS[1] if height >= high * width else None


def halves_of(image: GreyImage, split: Split) -> list[GreyImage]:
    """The two halves of an image (h, w, ...); without the middle line if there is an odd one."""
    if split == "side-by-side":
        half = image.shape[1] // 2
        return [image[:, :half].copy(), image[:, -half:].copy()]
    half = image.shape[0] // 2
    return [image[:half].copy(), image[-half:].copy()]


def split_photograph(file: PhotographFile, name: str, split: Split) -> list[bytes]:
    """The halves of a photograph as PNG, with colours if it has any."""
    image = read_colours(file, name)
    if (image == image[:, :, :1]).all():
        image = image[:, :, 0]
    coded = [cv2.imencode(".png", half) for half in halves_of(image, split)]
    if not all(done for done, _ in coded):
        raise StereocalError("its halves cannot be stored as images.", name)
    return [content.tobytes() for _, content in coded]


def keeping_halves(
    split: Split, folders: Sequence[str], keep: Callable[[str, bytes], object]
) -> Callable[[str, bytes], None]:
    """What keeps the halves of a photograph, each in the folder of its camera, in its place."""

    def keep_halves(name: str, content: bytes) -> None:
        for folder, half in zip(folders, split_photograph(content, name, split), strict=True):
            keep(f"{folder}/{PurePosixPath(name).with_suffix('.png').name}", half)

    return keep_halves


def split_photographs(
    photographs: Mapping[str, PhotographFile], split: Split, keep: Callable[[str, bytes], F]
) -> dict[str, F]:
    """The halves of all photographs, in folders `FOLDERS`; in memory is one at a time.

    Args:
        keep: stores a photograph.
    """
    halves: dict[str, F] = {}
    for name, file in photographs.items():
        for folder, content in zip(FOLDERS, split_photograph(file, name, split), strict=True):
            half = f"{folder}/{PurePosixPath(name).with_suffix('.png')}"
            half = half if half not in halves else f"{folder}/{name}.png"
            halves[half] = keep(half, content)
    return halves


def split_into(store: Path, photographs: Mapping[str, Path], split: Split) -> dict[str, Path]:
    """The halves of all photographs, as files in the folder `store`."""

    def keep(name: str, content: bytes) -> Path:
        path = store / f"{hashlib.sha256(name.encode()).hexdigest()[:32]}.png"
        write_atomically(path, content)
        return path

    return split_photographs(photographs, split, keep)
