"""The programs that are installed."""

import importlib

from benchmarks.peers.solution import Peer

MODULES = ("own", "opencv", "poselib", "pycolmap", "aniposelib", "caliscope", "scipy_joint")


def installed(modules: tuple[str, ...] = MODULES) -> tuple[list[Peer], list[str]]:
    """The programs that can be imported, and a line for each that cannot."""
    peers: list[Peer] = []
    skipped: list[str] = []
    for name in modules:
        try:
            peers += importlib.import_module(f"benchmarks.peers.{name}").PEERS
        except ImportError as error:
            skipped.append(f"{name} is skipped: {error}.")
    return peers, skipped
