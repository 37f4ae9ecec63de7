"""What the field sheet says: the pose of the cameras, what to measure, what to write down."""

import numpy as np

from stereocal.field.planning.bars import ground_from_primary
from stereocal.field.planning.plan import Plan
from stereocal.field.printing.print_target import planned_target
from stereocal.system.numbers import rounded

HAND_SPEED_M_S = 0.5
"""Speed of a target on a bar that is carried."""
BLUR_PX = 0.5
"""Motion during the exposure that does little harm."""
BLANK = "_" * 11
BESIDE = 0.2
"""Fraction of the baseline from which one camera is beside the other."""
PARALLEL_DEG, TILT_DEG, SMALL = 0.05, 0.7, 0.002
"""Angles, and distances as fractions of the baseline, below these are not worth a word."""
RECORDS = [
    ("Date, place, people", "", "Trigger, time offset of S", ""),
    ("Camera and lens P, serial", "", "Camera and lens S, serial", ""),
    ("Aperture, focus distance", "", "Exposure time, gain", ""),
    ("Image size, frames per s", "", "Baseline measured from - to", ""),
    ("Frames of the bar, first - last", "", "Board: squares, photographs", ""),
    ("Recordings, first - last", "", "Touched, moved: when", ""),
]
"""What to write down, and room for it."""


def camera_notes(plan: Plan) -> list[str]:
    """The pose of the cameras, and what holds for both; Paragraph markup."""
    points, size = plan.common_points, planned_target(plan)
    sizes = []
    for depth in (points[:, 2].min(), points[:, 2].max()):
        across, up = np.ptp(points[points[:, 2] == depth], axis=0)[:2]
        sizes.append(f"{rounded(across)} x {rounded(up)} m at {rounded(depth, 3)} m")
    largest = max(float(camera.K[0, 0]) for camera in (plan.primary, plan.secondary))
    px_per_ms = 1e-3 * HAND_SPEED_M_S * largest / plan.near_m
    targets = f"Targets of <b>{rounded(1e3 * size.side_m, 4)} mm</b>: {', '.join(size.widths)}."
    return [
        _placed(plan),
        _aimed(plan),
        f"Both see in common (grey): {sizes[0]}, {sizes[1]}.",
        "Lock focus, zoom and aperture with tape before the photographs of the board for the "
        "lenses, and leave them until the last recording. No autofocus, no stabilisation.",
        "Expose so that the white squares are not saturated.",
        "One trigger for both cameras; without it hold the bar at rest. Carried at "
        f"{HAND_SPEED_M_S:g} m/s at {rounded(plan.near_m, 4)} m it moves {rounded(px_per_ms)} px "
        f"per ms: expose for at most <b>{rounded(BLUR_PX / px_per_ms)} ms</b>, with both cameras "
        f"in step to <b>{rounded(plan.noise_px / px_per_ms)} ms</b>.",
        " ".join([targets, *size.advice]),
    ]


def measurements(plan: Plan) -> list[tuple[str, str, str]]:
    """What to measure, between which points and how, and room for the numbers."""
    baseline, bar = (
        f"{rounded(length, 4)} m, to {rounded(1e3 * sigma)} mm"
        for length, sigma in (
            (plan.baseline_m, plan.uncertainty.baseline_m),
            (plan.bar_m, plan.uncertainty.bar_m),
        )
    )
    way = plan.pose.inverse().T / plan.baseline_m
    # How the distance of two like points in front of the pupils differs from the baseline.
    per_cm = 10.0 * float((np.eye(3)[2] - plan.pose.R[2]) @ way)
    what, how = ("add", "in") if per_cm > 0 else ("subtract", "out")
    correction = (
        f" The cameras are turned {how}: {what} {abs(per_cm):.1f} mm for each cm that these points "
        "lie in front of the pupils."
    )
    return [
        (
            f"<b>Baseline</b>, planned<br/>{baseline}",
            "Between the entrance pupils: there the aperture appears to be when you look into a "
            "lens from the front. With two cameras of one kind, measure between like points, such "
            "as the middles of the front rings: the laser range finder with its rear edge at "
            f"one, a card at the other.{correction if abs(per_cm) >= 0.05 else ''}",
            f"1 {BLANK} m<br/>2 {BLANK} m<br/>3 {BLANK} m",
        ),
        (
            f"<b>Distance A-B</b>, planned<br/>{bar}",
            "Between the middles of the targets, where the four squares meet: with a steel tape or "
            "the laser, before and after, with the bar held as in the recording.",
            f"before {BLANK} m<br/>after {BLANK} m",
        ),
        (
            "<b>Heights</b> of the lenses",
            "Above the ground, with the tape; and whether each camera is level.",
            f"P {BLANK} m<br/>S {BLANK} m",
        ),
    ]


def _placed(plan: Plan) -> str:
    right, down, ahead = ground_from_primary(plan).R @ plan.pose.inverse().T
    parts = []
    if abs(right) > BESIDE * plan.baseline_m:
        parts.append(f"to the {'right' if right > 0 else 'left'}, seen from behind the cameras")
    higher = "higher" if down < 0 else "lower"
    farther = f"farther {'forward' if ahead > 0 else 'back'}"
    for away, word in ((down, higher), (ahead, farther)):
        if abs(away) > SMALL * plan.baseline_m:
            parts.append(f"<b>{rounded(abs(away), 3)} m {word}</b>")
    if abs(down) <= SMALL * plan.baseline_m:
        parts.append("at the same height")
    return (
        f"Secondary (S) <b>{rounded(plan.baseline_m, 4)} m</b> from the primary (P), "
        f"{', '.join(parts)}."
    )


def _aimed(plan: Plan) -> str:
    way, axes = plan.pose.inverse().T / plan.baseline_m, np.array([np.eye(3)[2], plan.pose.R[2]])
    turned = np.degrees(np.arcsin(axes @ way * (1, -1)))
    if np.abs(turned).max() < PARALLEL_DEG:
        return (
            "Both look straight ahead, at right angles to the line P-S: aim them at two marks "
            f"{rounded(plan.baseline_m, 4)} m apart."
        )
    how = [
        f"{name} {abs(angle):.1f}° {'in' if angle >= 0 else 'out'}"
        for name, angle in zip("PS", turned, strict=True)
    ]
    text = f"Turned from straight ahead: <b>{', '.join(how)}</b>."
    if turned.sum() > PARALLEL_DEG:
        meeting = plan.baseline_m / float(np.sum(np.tan(np.radians(turned))))
        text += (
            f" The axes meet about <b>{rounded(meeting, 3)} m</b> ahead: aim both at a mark there."
        )
    tilts = np.degrees(np.arcsin(-axes @ ground_from_primary(plan).R[1]))
    for name, tilt in zip("PS", tilts, strict=True):
        if abs(tilt) > TILT_DEG:
            text += f" {name} looks {abs(tilt):.1f}° {'up' if tilt > 0 else 'down'}."
    return text
