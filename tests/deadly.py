"""Readers for a guard's child that do what malformed files make decoders do."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from stereocal.errors import StereocalError
from stereocal.system.guarded import Reader


def _abort(*_: object) -> None:
    os.abort()


def _eat(*_: object) -> None:
    held = []
    while True:
        held.append(np.empty(100_000_000, np.uint8))  # addresses, no memory


def _spin(path: Path) -> None:
    _begun(path)
    while True:
        pass


def _hang(path: Path) -> None:
    _begun(path)
    time.sleep(1000)


def _wait(path: Path) -> None:
    _begun(path)
    while not path.with_suffix(".go_on").exists():
        time.sleep(0.01)


def _begun(path: Path) -> None:
    path.with_suffix(".begun").write_text(str(os.getpid()))


def _refuse(_: Path) -> None:
    raise StereocalError("damaged")


def _raise(_: Path) -> None:
    raise ZeroDivisionError


def _print(_: Path) -> None:
    os.write(1, b"from the decoder\n")
    os.write(2, b"from the decoder\n")


def _fine(_: Path) -> None:
    pass


READERS: Mapping[str, Reader] = {
    "abort": _abort,
    "hang": _hang,
    "spin": _spin,
    "eat": _eat,
    "raise": _raise,
    "refuse": _refuse,
    "print": _print,
    "wait": _wait,
    "fine": _fine,
}
ALL_ABORT: Mapping[str, Reader] = dict.fromkeys(("photograph", "table"), _abort)
"""The kinds that the dashboard tries; each file of them crashes."""
