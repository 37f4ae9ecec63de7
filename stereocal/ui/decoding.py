"""Files for native decoders: on a shared server, a child process tries them first."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path

from stereocal.matching.point_table import PointTable
from stereocal.projects.server_settings import ServerSettings
from stereocal.system.guarded import Guard, Reader
from stereocal.system.photograph import read_photograph

CHILDREN = 2
"""Two, so that a slow file of one session does not block the others."""


def server_guard() -> Guard:
    """The guard of this process. On a personal computer it decodes directly."""
    return _guard(CHILDREN if ServerSettings.from_environment().shared else 0)


@cache
def _guard(children: int) -> Guard:
    return Guard(READERS, children)


def _table(path: Path) -> None:
    PointTable(path, ("u", "v"), path.name).check()


READERS: Mapping[str, Reader] = {"photograph": read_photograph, "table": _table}
