"""Drawings of the field guide: what to build, and between which points to measure."""

from math import asin, cos, radians, sin, tan

from docs.drawings.canvas import BAD, BLUE, FAINT, GREY, INK, ORANGE, Canvas, Point


def rig() -> Canvas:
    """Two cameras from above, turned in towards a bar with two targets; the baseline between the
    cameras and the distance between the targets are measured.
    """
    c = Canvas(720, 400)
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
    """A bar with a 2x2 checkerboard at each end. The distance A–B is measured between the two
    points where the four squares meet.
    """
    c = Canvas(720, 230)
    c.line((120, 100), (600, 100), GREY, 9)
    for x, name in ((120, "A"), (600, "B")):
        c.target((x, 100), 90)
        c.dot((x, 100), 5, ORANGE)
        c.text((x, 40), name, INK, 18, bold=True)
        c.line((x, 106), (x, 186), ORANGE, 1.5, "5 4")
    c.arrow((122, 178), (598, 178), ORANGE, both=True)
    c.text((360, 168), "distance A–B", ORANGE, bold=True)
    c.text(
        (360, 206), "between the points where the four squares meet, by steel tape, to 0.5 mm", INK
    )
    c.text((360, 86), "stiff: it must not bend when you swing it", GREY)
    return c


def baseline() -> Canvas:
    """The baseline runs between the entrance pupils, the images of the apertures seen from the
    front. Between other points of cameras that are turned in it is wrong by 2 d sin a.
    """
    c = Canvas(720, 400)
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
    ends = [
        (at[0] - back * cos(radians(t)), at[1] + back * sin(radians(t)))
        for at, t in ((left, a), (right, 180 - a))
    ]
    for at in ends:
        c.dot(at, 5, BAD)
    c.arrow((ends[0][0] + 8, ends[0][1]), (ends[1][0] - 8, ends[1][1]), BAD, both=True)
    c.text((360, ends[0][1] + 24), "between the tripod screws: longer by 2 d sin a", BAD)
    c.text((202, 92), "a", INK, 17, bold=True)
    c.text((140, 240), "d", INK, 17, bold=True)
    c.text(
        (360, 326),
        "a: how far each camera is turned in\nd: from the screw to the pupil, along the lens",
        INK,
    )
    c.text((360, 374), "Example: d = 80 mm and a = 10 degrees make 28 mm, 0.6 % of 4.5 m.", GREY)
    c.text(
        (360, 40),
        "entrance pupil: where the aperture seems to be when you look into the lens",
        BLUE,
    )
    c.line((300, 50), (196, 192), BLUE, 1)
    return c


def pupil() -> Canvas:
    """Turn the camera on a rail until a near and a far edge keep their place beside each other:
    then it turns about its entrance pupil.
    """
    c = Canvas(720, 315)
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
    c.text(
        (360, 24), "a near rod (grey) in front of a far edge (black), as the camera sees them", GREY
    )
    return c


def synchronisation() -> Canvas:
    """If the second camera takes its picture later, a moving bar is elsewhere by then, and the two
    rays meet in a wrong place.
    """
    c = Canvas(720, 280)
    for y, name, late in ((70.0, "primary", 0.0), (130.0, "secondary", 24.0)):
        c.text((98, y + 5), name, INK, anchor="end")
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
    c.text((592, 200), "bar moved by speed × t", INK)
    c.text(
        (360, 238),
        "1 m/s and 1 ms make 1 mm: 0.5 px at 15 m with a focal length of 7120 px.\n"
        "A bar at rest makes no error.",
        GREY,
    )
    return c


def water() -> Canvas:
    """Two cameras in air before the wall of a tank, from above. Each ray bends at both faces of the
    wall. Thickness and indices are given; where the wall is, is found, or measured too.
    """
    c = Canvas(720, 440)
    dry, wet = 240.0, 226.0
    c.rectangle((20, 40), (680, wet - 40), "#E4F1F8", "none", 0)
    c.rectangle((20, wet), (680, dry - wet), "#B9C6CE", GREY, 1)
    left, right, bar = (150.0, 390.0), (570.0, 390.0), ((330.0, 120.0), (412.0, 84.0))
    for camera, angle in ((left, 50.0), (right, 130.0)):
        for end in bar:
            face, inside = _bent(camera, end, dry, wet)
            straight = (1.6 * face[0] - 0.6 * camera[0], 1.6 * face[1] - 0.6 * camera[1])
            c.line(face, straight, GREY, 1, "3 5")
            for start, stop in ((camera, face), (face, inside), (inside, end)):
                c.line(start, stop, BLUE, 2)
        c.camera(camera, angle)
    c.bar(*bar, 22)
    c.text((306, 116), "A", INK, bold=True)
    c.text((438, 82), "B", INK, bold=True)
    c.arrow((172, 408), (548, 408), BLUE, both=True)
    c.text((360, 429), "baseline, in air", BLUE)
    c.line((30, 390), (128, 390), GREY, 1.5, "5 4")
    c.arrow((40, 388), (40, dry + 2), GREY, both=True)
    c.text((50, 266), "distance,\nalong the normal:\nfound, or measured", GREY, 16, anchor="start")
    c.arrow((676, 194), (676, wet - 2), ORANGE)
    c.arrow((676, 272), (676, dry + 2), ORANGE)
    c.text((666, 292), "thickness,\nby caliper", ORANGE, anchor="end")
    c.text((40, 70), "water: index 1.333", INK, anchor="start")
    c.text((490, 190), "wall: index 1.49 (acrylic)\nor 1.52 (glass)", INK, 16, anchor="start")
    c.text((360, 350), "air", INK)
    c.text((450, 114), "bar: distance A–B", ORANGE, anchor="start")
    return c


def _bent(camera: Point, end: Point, dry: float, wet: float) -> tuple[Point, Point]:
    """Where the ray from a camera to a point passes the dry and the wet face of a wall."""
    layers = ((camera[1] - dry, 1.0), (dry - wet, 1.5), (wet - end[1], 1.333))
    low, high, passed = -0.99, 0.99, [camera[0]]
    for _ in range(50):
        sine, passed = 0.5 * (low + high), [camera[0]]
        for depth, index in layers:
            passed.append(passed[-1] + depth * tan(asin(sine / index)))
        low, high = (sine, high) if passed[-1] < end[0] else (low, sine)
    return (passed[1], dry), (passed[2], wet)
