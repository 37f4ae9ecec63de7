"""Readers for a guard's child that do what malformed files make decoders do."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

from stereocal.errors import StereocalError
from stereocal.system.guarded_child import GuardedReader, Prepared


def _eat(_: Path) -> None:
    held = []
    while True:
        held.append(bytearray(10_000_000))


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
    path.with_suffix(".begun").touch()


def _refuse(_: Path) -> None:
    raise StereocalError("damaged")


def _count(path: Path) -> None:
    with path.with_suffix(".count").open("a") as file:
        file.write("x")


def _raise(_: Path) -> None:
    raise ZeroDivisionError


def _prepared(read: Callable[[Path], object], path: Path) -> Prepared:
    return 200_000_000, partial(read, path)


READERS: Mapping[str, GuardedReader] = {
    name: partial(_prepared, read)
    for name, read in {
        "abort": lambda _: os.abort(),
        "exit": lambda _: os._exit(0),
        "hang": _hang,
        "spin": _spin,
        "eat": _eat,
        "raise": _raise,
        "refuse": _refuse,
        "count": _count,
        "print": lambda _: os.write(1, b"survived\nfailed\n"),
        "wait": _wait,
        "fine": lambda _: None,
    }.items()
}
