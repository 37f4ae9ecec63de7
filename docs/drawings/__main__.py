"""Draw the pictures of the field guide and of the architecture: `make pictures`."""

from collections.abc import Callable, Mapping
from pathlib import Path

from docs.drawings import layers, measuring, photographing
from docs.drawings.canvas import Canvas

FOLDER = Path(__file__).parents[1] / "pictures" / "guide"
DRAWINGS: Mapping[str, Callable[[], Canvas]] = {
    function.__name__: function
    for function in (
        measuring.rig,
        measuring.bar,
        photographing.targets,
        photographing.size,
        measuring.baseline,
        measuring.pupil,
        measuring.synchronisation,
        measuring.water,
        photographing.places,
        photographing.images,
        photographing.board,
        photographing.trouble,
        layers.layers,
    )
}


def draw(folder: Path) -> None:
    """Write all drawings, `NAME.svg`."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, function in DRAWINGS.items():
        (folder / f"{name}.svg").write_text(function().svg(str(function.__doc__)), encoding="utf-8")


if __name__ == "__main__":
    draw(FOLDER)
