"""Readers that do in a guard's child what malformed files make decoders do."""

import os
import time
from pathlib import Path

import numpy as np

from stereocal.errors import StereocalError


def abort(*_: object) -> None:
    os.abort()


def eat(*_: object) -> None:
    held = []
    while True:
        held.append(np.empty(100_000_000, np.uint8))  # addresses, no memory


def spin(path: Path) -> None:
    _begun(path)
    while True:
        pass


def hang(path: Path) -> None:
    _begun(path)
    time.sleep(1000)


def _begun(path: Path) -> None:
    path.with_suffix(".begun").write_text(str(os.getpid()))


def refuse(_: Path) -> None:
    raise StereocalError("damaged")


def divide(_: Path) -> None:
    raise ZeroDivisionError


def say(_: Path) -> int:
    os.write(1, b"from the decoder\n")
    return os.write(2, b"from the decoder\n")
