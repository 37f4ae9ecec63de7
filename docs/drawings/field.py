"""The drawings of the field guide: what to build, where to measure, where to hold the bar."""

from __future__ import annotations

from math import cos, radians, sin

from docs.drawings.canvas import BAD, BLUE, FAINT, GREEN, GREY, INK, ORANGE, Canvas


def rig() -> Canvas:
    """Everything that is needed, from above."""
    c = Canvas(720, 400, "Two cameras from above, turned in towards a bar with two targets; the "
               "baseline between the cameras and the distance between the targets are measured.")  # fmt: skip
    left, right = (150.0, 330.0), (570.0, 330.0)
    for at, angle in ((left, 62.0), (right, 118.0)):
        for spread in (-22, 22):
            a = radians(angle + spread)
            c.line(at, (at[0] + 300 * cos(a), at[1] - 300 * sin(a)), FAINT, 2)
    c.camera(left, 62, "primary camera")
    c.camera(right, 118, "secondary camera")
    c.arrow((170, 330), (550, 330), BLUE, both=True)
    c.text((360, 320), "baseline: entrance pupil to entrance pupil", BLUE)
    c.bar((315, 120), (400, 88), 26)
    c.arrow((322, 151), (414, 116), ORANGE, both=True)
    c.text((440, 155), "distance A–B:\ncentre to centre", ORANGE, anchor="start")
    c.text((292, 112), "A", INK, bold=True)
    c.text((424, 80), "B", INK, bold=True)
    c.text((360, 30), "both targets in the view of both cameras", GREY)
    return c


def bar() -> Canvas:
    """Where the distance A-B is measured."""
    c = Canvas(720, 230, "A bar with a 2x2 checkerboard at each end. The distance A–B is measured "
               "between the two points where the four squares meet.")  # fmt: skip
    c.line((120, 100), (600, 100), GREY, 9)
    for x, name in ((120, "A"), (600, "B")):
        c.target((x, 100), 90)
        c.dot((x, 100), 5, ORANGE)
        c.text((x, 40), name, INK, 18, bold=True)
        c.line((x, 106), (x, 186), ORANGE, 1.5, "5 4")
    c.arrow((122, 178), (598, 178), ORANGE, both=True)
    c.text((360, 168), "distance A–B", ORANGE, bold=True)
    c.text((360, 206), "between the points where the four squares meet, by steel tape, to 0.5 mm",
           INK)  # fmt: skip
    c.text((360, 86), "stiff: it must not bend when you swing it", GREY)
    return c


def targets() -> Canvas:
    """A good target and five that are not."""
    c = Canvas(720, 250, "A target that is flat, matt and whole is found. Glare, a bent print, a "
               "tilt of more than 60 degrees, a hidden corner or motion blur spoil it.")  # fmt: skip
    names = ("flat, matt,\nwhole", "glare", "bent\nprint", "tilted over\n60 degrees", "partly\nhidden",
             "motion\nblur")  # fmt: skip
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
    """How large a target must be in the image."""
    c = Canvas(720, 210, "Targets 20, 50 and 400 pixels across: the least, a good size, and the "
               "largest that is found.")  # fmt: skip
    c.rectangle((20, 20), (300, 170), "#F4F6F7", GREY)
    c.target((70, 100), 8)
    c.text((70, 140), "20 px\nthe least", INK, 14)
    c.target((150, 100), 20)
    c.text((150, 140), "50 px\ngood", INK, 14)
    c.target((250, 90), 110)
    c.text((250, 170), "up to 400 px", INK, 14)
    c.text((350, 60), "side of the board on the bar", INK, anchor="start", bold=True)
    c.text((350, 88), "= 50 px × distance / focal length in px", INK, anchor="start")
    c.text((350, 128), "Example: at 25 m, with 7120 px,", GREY, anchor="start")
    c.text((350, 150), "50 × 25 m / 7120 = 0.18 m", GREY, anchor="start")
    c.text((350, 180), "Take the farthest distance of your bar.", GREY, anchor="start")
    return c


def baseline() -> Canvas:
    """Between which points the baseline is measured."""
    c = Canvas(720, 380, "The baseline runs between the entrance pupils, the images of the "
               "apertures seen from the front. Between other points of cameras that are turned in "
               "it is wrong by 2 d sin a.")  # fmt: skip
    left, right, a = (190.0, 200.0), (530.0, 200.0), 65.0
    c.camera(left, a)
    c.camera(right, 180 - a)
    for at, angle in ((left, a), (right, 180 - a)):
        r = radians(angle)
        c.line(at, (at[0] + 150 * cos(r), at[1] - 150 * sin(r)), FAINT, 2, "7 5")
        c.line(at, (at[0], at[1] - 120), FAINT, 2)
        c.dot(at, 6, BLUE)
    c.arrow((200, 200), (520, 200), BLUE, both=True)
    c.text((360, 190), "baseline: pupil to pupil", BLUE, bold=True)
    back = 60.0
    ends = [(at[0] - back * cos(radians(t)), at[1] + back * sin(radians(t)))
            for at, t in ((left, a), (right, 180 - a))]  # fmt: skip
    for at in ends:
        c.dot(at, 5, BAD)
    c.arrow((ends[0][0] + 8, ends[0][1]), (ends[1][0] - 8, ends[1][1]), BAD, both=True)
    c.text((360, ends[0][1] + 24), "between the tripod screws: longer by 2 d sin a", BAD)
    c.text((202, 92), "a", INK, 17, bold=True)
    c.text((140, 240), "d", INK, 17, bold=True)
    c.text((360, 326), "a: how far each camera is turned in.  d: from the screw to the pupil, along "
           "the lens.", INK)  # fmt: skip
    c.text((360, 352), "Example: d = 80 mm and a = 10 degrees make 28 mm, 0.6 % of 4.5 m.", GREY)
    c.text((360, 40), "entrance pupil: where the aperture seems to be when you look into the lens",
           BLUE)  # fmt: skip
    c.line((300, 50), (196, 192), BLUE, 1)
    return c


def pupil() -> Canvas:
    """How the entrance pupil is found."""
    c = Canvas(720, 315, "Turn the camera on a rail until a near and a far edge keep their place "
               "beside each other: then it turns about its entrance pupil.")  # fmt: skip
    for x, good in ((180.0, True), (540.0, False)):
        pivot = (x, 220.0)
        for angle in (65.0, 90.0, 115.0):
            r = radians(angle)
            shift = 0 if good else 42
            c.camera((x + shift * cos(r), 220 - shift * sin(r)), angle)
        c.dot(pivot, 6, BLUE if good else BAD)
        for k, offset in enumerate((-70, 0, 70)):
            gap = 0 if good else 9 * (k - 1)
            c.line((x + offset, 60), (x + offset, 110), GREY, 7)
            c.line((x + offset + gap, 40), (x + offset + gap, 60), INK, 3)
        c.mark((x + 120, 85), good)
    c.text((180, 280), "turned about the pupil:\nnear and far stay in line", INK)
    c.text((540, 280), "turned about another point:\nthey slide past each other", INK)
    c.text((360, 24), "a near rod (grey) in front of a far edge (black), as the camera sees them",
           GREY)  # fmt: skip
    return c


def synchronisation() -> Canvas:
    """What a moving bar does when the cameras are out of step."""
    c = Canvas(720, 280, "If the second camera takes its picture later, a moving bar is elsewhere "
               "by then, and the two rays meet in a wrong place.")  # fmt: skip
    for y, name, late in ((70.0, "primary", 0.0), (130.0, "secondary", 24.0)):
        c.text((90, y + 5), name, INK, anchor="end")
        c.line((105, y), (430, y), FAINT, 2)
        for k in range(5):
            x = 125 + 70 * k
            c.rectangle((x + late, y - 14), (14, 28), BLUE if not late else BAD, "none", 0)
    c.line((125, 40), (125, 160), GREY, 1, "4 4")
    c.line((149, 100), (149, 160), GREY, 1, "4 4")
    c.arrow((90, 160), (125, 160), GREY)
    c.arrow((184, 160), (149, 160), GREY)
    c.text((137, 184), "out of step by t", BAD)
    c.line((480, 170), (690, 40), FAINT, 2, "6 5")
    c.bar((505, 120), (585, 155), 20, BLUE)
    c.bar((575, 72), (655, 107), 20, BAD)
    c.arrow((560, 145), (628, 100), INK)
    c.text((600, 200), "the bar moved by speed × t", INK)
    c.text((360, 238), "1 m/s and 1 ms make 1 mm: 0.5 px at 15 m with a focal length of 7120 px.\n"
           "A bar at rest makes no error.", GREY)  # fmt: skip
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
    """Where to hold the bar, from above."""
    c = Canvas(720, 390, "From above: bars near and far, left and right and in all directions are "
               "good; bars all at one distance and in one direction are not.")  # fmt: skip
    _view(c, 185, True)
    _view(c, 535, False)
    good = [(150, 70, 30), (205, 88, 100), (180, 125, 60), (144, 105, 150), (228, 125, 20),
            (162, 158, 120), (203, 168, 0), (185, 195, 90), (222, 60, 160), (180, 50, 10)]  # fmt: skip
    for x, y, angle in good:
        dx, dy = 15 * cos(radians(angle)), 15 * sin(radians(angle))
        c.bar((x - dx, y + dy), (x + dx, y - dy))
    for k in range(5):
        c.bar((474 + 25 * k, 125), (492 + 25 * k, 125), colour=BAD)
    c.text((185, 364), "near, middle and far; left and right;\nhigh and low; every direction", INK)
    c.text((535, 364), "one distance, one direction:\nthe angles cannot be told apart", INK)
    return c


def images() -> Canvas:
    """Where the bar should be in the image."""
    c = Canvas(720, 260, "In the image: bars all over it, up to the borders, are good; bars in the "
               "middle alone are not.")  # fmt: skip
    for x, good in ((40.0, True), (390.0, False)):
        c.rectangle((x, 20), (290, 170), "#F4F6F7", GREY)
        if good:
            ends = [(30, 30, 90, 45), (180, 25, 260, 50), (120, 70, 150, 130), (40, 110, 100, 140),
                    (200, 95, 265, 75), (190, 145, 255, 155), (20, 70, 60, 60), (140, 30, 160, 55)]  # fmt: skip
        else:
            ends = [(120, 70, 160, 85), (140, 60, 170, 90), (125, 95, 165, 100), (150, 80, 180, 75)]
        for x1, y1, x2, y2 in ends:
            c.bar((x + x1, 20 + y1), (x + x2, 20 + y2), colour=ORANGE if good else BAD)
        c.mark((x + 270, 40), good)
    c.text((165, 222), "about 25 bars all over both images,\nboth targets whole in both", INK)
    c.text((515, 222), "in the middle alone:\nthe lens is untested elsewhere", INK)
    return c


def board() -> Canvas:
    """Photographs of the board for the lens."""
    c = Canvas(720, 250, "Photographs of the chessboard: large, in every corner of the image, tilted "
               "in different directions.")  # fmt: skip
    views = [(0, 0, 1.0, 0), (-30, -13, 0.75, -6), (33, 14, 0.6, 5), (-22, 8, 0.6, 24),
             (0, 0, 0.3, 0)]  # fmt: skip
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
    names = ("whole board,\nlarge", "each corner", "of the image", "tilted by\n20 to 50°",
             "small, and\nalways frontal")  # fmt: skip
    for k, name in enumerate(names):
        c.text((78 + 141 * k, 190), name, INK, 14)
    return c


def trouble() -> Canvas:
    """What else goes wrong on a field day."""
    c = Canvas(720, 270, "What spoils a field day: focus or zoom changed, a camera bumped, files of "
               "the cameras exchanged, images cropped or turned, water or glass in between.")  # fmt: skip
    names = ("focus or zoom\nchanged later", "a camera was\nbumped", "the cameras'\nfiles exchanged",
             "images cropped,\nscaled or turned", "glass or water\nin between")  # fmt: skip
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
        c.text((x, 222), name, INK, 14)
    return c
