"""Draw the pictures of the field guide and of the architecture: `make drawings`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from docs.drawings import field, layers
from docs.drawings.canvas import Canvas

FOLDER = Path(__file__).parents[1] / "pictures" / "guide"
DRAWINGS: Mapping[str, Callable[[], Canvas]] = {
    function.__name__: function
    for function in (
        field.rig, field.bar, field.targets, field.size, field.baseline, field.pupil,
        field.synchronisation, field.places, field.images, field.board, field.trouble, layers.layers,
    )
}  # fmt: skip


def draw(folder: Path) -> None:
    """Write all drawings, `NAME.svg`."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, function in DRAWINGS.items():
        (folder / f"{name}.svg").write_text(function().svg(), encoding="utf-8")


if __name__ == "__main__":
    draw(FOLDER)
