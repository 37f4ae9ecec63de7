"""Where `app.py`, `pages/`, `assets/` and `sample_data/` are, installed or not."""

from pathlib import Path

PACKAGE = Path(__file__).parents[1]
INSTALLED = PACKAGE / "dashboard"
"""The wheel puts them here; see pyproject.toml."""
ROOT = INSTALLED if INSTALLED.is_dir() else PACKAGE.parent
"""The folder in which they are."""
