"""Settings of the server, from environment variables; docs/deploy.md lists them."""

import math
import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from stereocal.errors import StereocalError
from stereocal.system.limits import MB, from_environment

MOST_WORKERS = 1000


@dataclass(frozen=True)
class ServerSettings:
    """Settings that differ between a personal computer and a shared server."""

    shared: bool = False
    """STEREOCAL_SHARED=1: no list of projects is shown; a project is opened by its address."""
    keep_days: float = math.inf
    """STEREOCAL_KEEP_DAYS: projects unchanged for longer are removed."""
    undo_days: float = 30.0
    """STEREOCAL_UNDO_DAYS: how long a removed project can be brought back."""
    project_mb: float = math.inf
    """STEREOCAL_PROJECT_MB: quota of one project on disk, in millions of bytes."""
    download_mb: float = 2000.0
    """STEREOCAL_DOWNLOAD_MB: the largest project that is packed for download; the zip is in memory
    while its page is open."""
    workers: int = field(default_factory=lambda: os.cpu_count() or 1)
    """STEREOCAL_WORKERS: number of concurrent tasks, for all sessions together."""

    @classmethod
    def from_environment(cls, environment: Mapping[str, str] | None = None) -> "ServerSettings":
        """The settings of this server; missing ones have defaults."""
        settings = from_environment(cls, "STEREOCAL_", environment)
        workers = int(min(max(settings.workers, 1), MOST_WORKERS))
        return replace(settings, shared=settings.shared > 0, workers=workers)


def default_home() -> Path:
    """STEREOCAL_HOME, or the user's data directory."""
    if folder := os.environ.get("STEREOCAL_HOME"):
        return Path(folder)
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData/Local")) / "stereocal"
    if sys.platform == "darwin":
        return Path.home() / "Library/Application Support/stereocal"
    return Path(os.environ.get("XDG_DATA_HOME", Path.home() / ".local/share")) / "stereocal"


def check_quota(size: int, coming: int = 0) -> None:
    """Check the size in bytes of a project, with `coming` bytes more, against the limit."""
    limit = ServerSettings.from_environment().project_mb * MB
    if size + coming > limit:
        raise StereocalError(
            f"A project may take {limit / MB:g} MB on this server. This one has {size / MB:.1f} MB"
            + (f", and {coming / MB:.1f} MB would be added" if coming else "")
            + ": remove photographs, board photographs or further data sets that are not needed, "
            "or begin another project."
        )
