"""The folders of the program, for the page on its architecture."""

from docs.drawings.canvas import BLUE, GREY, INK, Canvas

LAYERS = (
    ("what people run", ("workflow", "paper_kit", "projects", "commands", "ui")),
    ("files and figures", ("formats", "figures")),
    (
        "from photographs, and to points",
        ("simulation", "detection", "frames", "intrinsics", "matching", "field"),
    ),
    ("the method", ("calibration", "fit", "evaluation", "verdict")),
    ("ground", ("errors", "system", "rig")),
)


def layers() -> Canvas:
    """Five layers of folders, each of which imports only from those below it."""
    row, width = 74, 720
    c = Canvas(width, 20 + row * len(LAYERS))
    for k, (name, folders) in enumerate(LAYERS):
        top = 14.0 + row * k
        c.rectangle((14, top), (width - 28, 58), "#F4F6F7", GREY, 1)
        c.text((26, top + 19), name, GREY, 15, anchor="start")
        for j, folder in enumerate(folders):
            c.text((80 + 112 * j, top + 44), folder, INK, 16, bold=True)
        if k:
            c.arrow((width - 40, top - 22), (width - 40, top + 14), BLUE)
    return c
