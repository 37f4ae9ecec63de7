"""Drawings of the field guide: targets, and where to hold bar and board."""

from math import cos, radians, sin

from docs.drawings.canvas import BAD, BLUE, FAINT, GREEN, GREY, INK, ORANGE, Canvas


def targets() -> Canvas:
    """A target that is flat, matt and whole is found. Glare, a bent print, a tilt of more than 60
    degrees, a hidden corner or motion blur spoil it.
    """
    c = Canvas(720, 250)
    names = (
        "flat, matt,\nwhole",
        "glare",
        "bent\nprint",
        "tilted over\n60 degrees",
        "partly\nhidden",
        "motion\nblur",
    )
    for k, name in enumerate(names):
        x = 65.0 + 118 * k
        at = (x, 90.0)
        if name == "bent\nprint":
            c.polygon([(x - 38, 52), (x, 62), (x, 100), (x - 38, 90)], INK, INK, 1)
            c.polygon([(x, 62), (x + 38, 52), (x + 38, 90), (x, 100)], "white", INK, 1)
            c.polygon([(x - 38, 90), (x, 100), (x, 138), (x - 38, 128)], "white", INK, 1)
            c.polygon([(x, 100), (x + 38, 90), (x + 38, 128), (x, 138)], INK, INK, 1)
        else:
            c.target(at, 76, squeeze=0.3 if "tilted" in name else 1)
        if name == "glare":
            c.parts.append(f'<circle cx="{x - 12}" cy="80" r="34" fill="white" opacity="0.92"/>')
        if "hidden" in name:
            c.polygon([(x - 50, 60), (x + 10, 48), (x + 2, 108), (x - 40, 132)], GREEN, GREEN)
        if "blur" in name:
            for shift in (-12, -6, 6, 12):
                c.parts.append(
                    f'<rect x="{x - 38 + shift}" y="52" width="76" height="76" fill="{INK}" '
                    'opacity="0.22"/>'
                )
        c.mark((x, 166), good=k == 0)
        c.text((x, 204), name, INK)
    return c


def size() -> Canvas:
    """Targets 20, 50 and 400 pixels across: the least, a good size, the largest that is found."""
    c = Canvas(720, 210)
    c.rectangle((20, 20), (300, 170), "#F4F6F7", GREY)
    c.target((70, 100), 8)
    c.text((70, 140), "20 px\nthe least", INK, 16)
    c.target((150, 100), 20)
    c.text((150, 140), "50 px\ngood", INK, 16)
    c.target((250, 90), 110)
    c.text((250, 170), "up to 400 px", INK, 16)
    c.text((350, 60), "side of the board on the bar", INK, anchor="start", bold=True)
    c.text((350, 88), "= 50 px × distance / focal length in px", INK, anchor="start")
    c.text((350, 128), "Example: at 25 m, with 7120 px,", GREY, anchor="start")
    c.text((350, 150), "50 × 25 m / 7120 = 0.18 m", GREY, anchor="start")
    c.text((350, 180), "Take the farthest distance of your bar.", GREY, anchor="start")
    return c


def _view(c: Canvas, x: float, good: bool) -> list[tuple[float, float]]:
    left, right = (x - 90, 300.0), (x + 90, 300.0)
    for at, a, b in ((left, 45.0, 82.0), (right, 98.0, 135.0)):
        for angle in (a, b):
            r = radians(angle)
            c.line(at, (at[0] + 250 * cos(r), at[1] - 250 * sin(r)), FAINT, 2)
    c.camera(left, 64)
    c.camera(right, 116)
    c.mark((x + 140, 40), good)
    return [left, right]


def places() -> Canvas:
    """From above: bars near and far, left and right and in all directions are good; bars all at
    one distance and in one direction are not.
    """
    c = Canvas(720, 390)
    _view(c, 185, True)
    _view(c, 535, False)
    good = [
        (150, 70, 30),
        (205, 88, 100),
        (180, 125, 60),
        (144, 105, 150),
        (228, 125, 20),
        (162, 158, 120),
        (203, 168, 0),
        (185, 195, 90),
        (222, 60, 160),
        (180, 50, 10),
    ]
    for x, y, angle in good:
        dx, dy = 15 * cos(radians(angle)), 15 * sin(radians(angle))
        c.bar((x - dx, y + dy), (x + dx, y - dy))
    for k in range(5):
        c.bar((474 + 25 * k, 125), (492 + 25 * k, 125), colour=BAD)
    c.text((185, 364), "near, middle and far; left and right;\nhigh and low; every direction", INK)
    c.text((535, 364), "one distance, one direction:\nthe angles cannot be told apart", INK)
    return c


def images() -> Canvas:
    """In the image: bars all over it, up to the borders, are good; bars in the middle alone are
    not.
    """
    c = Canvas(720, 260)
    for x, good in ((40.0, True), (390.0, False)):
        c.rectangle((x, 20), (290, 170), "#F4F6F7", GREY)
        if good:
            ends = [
                (30, 30, 90, 45),
                (180, 25, 260, 50),
                (120, 70, 150, 130),
                (40, 110, 100, 140),
                (200, 95, 265, 75),
                (190, 145, 255, 155),
                (20, 70, 60, 60),
                (140, 30, 160, 55),
            ]
        else:
            ends = [(120, 70, 160, 85), (140, 60, 170, 90), (125, 95, 165, 100), (150, 80, 180, 75)]
        for x1, y1, x2, y2 in ends:
            c.bar((x + x1, 20 + y1), (x + x2, 20 + y2), colour=ORANGE if good else BAD)
        c.mark((x + 270, 40), good)
    c.text((165, 222), "about 25 bars all over both images,\nboth targets whole in both", INK)
    c.text((515, 222), "in the middle alone:\nthe lens is untested elsewhere", INK)
    return c


def board() -> Canvas:
    """Photographs of the chessboard: large, in every corner of the image, tilted in different
    directions.
    """
    c = Canvas(720, 250)
    views = [
        (0, 0, 1.0, 0),
        (-30, -13, 0.75, -6),
        (33, 14, 0.6, 5),
        (-22, 8, 0.6, 24),
        (0, 0, 0.3, 0),
    ]
    for k, (dx, dy, squeeze, turn) in enumerate(views):
        x, good = 15.0 + 141 * k, k < 4
        c.rectangle((x, 30), (126, 96), "#F4F6F7", GREY)
        side = (28.0, 21.0, 20.0, 20.0, 9.0)[k]
        middle = (x + 63 + dx, 78.0 + dy)
        r = radians(turn)
        for i in range(-1, 2):
            for j in range(-1, 2):
                u, v = i * side * (squeeze if good else 1), j * side
                at = (middle[0] + u * cos(r) - v * sin(r), middle[1] + u * sin(r) + v * cos(r))
                c.target(at, side, turn, squeeze if good else 1)
        c.mark((x + 63, 152), good)
    names = (
        "whole board,\nlarge",
        "each corner",
        "of the image",
        "tilted by\n20 to 50°",
        "small, and\nalways frontal",
    )
    for k, name in enumerate(names):
        c.text((78 + 141 * k, 190), name, INK, 16)
    return c


def trouble() -> Canvas:
    """What spoils a field day: focus or zoom changed, a camera bumped, files of the cameras
    exchanged, images cropped or turned, water or glass in between.
    """
    c = Canvas(720, 270)
    names = (
        "focus or zoom\nchanged later",
        "a camera was\nbumped",
        "the cameras'\nfiles exchanged",
        "images cropped,\nscaled or turned",
        "glass or water\nin between",
    )
    for k, name in enumerate(names):
        x = 75.0 + 143 * k
        if k == 0:
            c.dot((x, 90), 42, "white", GREY)
            c.dot((x, 90), 26, FAINT, GREY)
            c.arrow((x - 36, 40), (x + 36, 40), BAD)
        elif k == 1:
            c.camera((x - 12, 80), 90)
            c.camera((x + 14, 84), 66)
            c.line((x - 40, 150), (x + 40, 150), GREY, 3)
        elif k == 2:
            c.text((x - 30, 70), "left", INK)
            c.text((x + 30, 70), "right", INK)
            c.arrow((x - 28, 82), (x + 28, 128), BAD)
            c.arrow((x + 28, 82), (x - 28, 128), BAD)
            c.text((x - 30, 146), "left", GREY)
            c.text((x + 30, 146), "right", GREY)
        elif k == 3:
            c.rectangle((x - 48, 50), (96, 80), "white", GREY)
            c.rectangle((x - 28, 66), (56, 46), "none", BAD, 3)
        else:
            c.polygon([(x + 8, 40), (x + 20, 40), (x + 20, 150), (x + 8, 150)], "#D6EAF5", BLUE, 1)
            c.line((x - 45, 130), (x + 8, 95), INK, 2)
            c.line((x + 8, 95), (x + 20, 89), INK, 2)
            c.line((x + 20, 89), (x + 52, 72), INK, 2)
        c.mark((x, 180), False)
        c.text((x, 222), name, INK, 16)
    return c
