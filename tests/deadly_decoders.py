"""Readers for a guard's child that crash, whatever the file is."""

from __future__ import annotations

import os
from collections.abc import Mapping

from stereocal.formats.guarded_readers import READERS as REAL
from stereocal.system.guarded_child import GuardedReader

READERS: Mapping[str, GuardedReader] = dict.fromkeys(REAL, lambda _: (200_000_000, os.abort))
