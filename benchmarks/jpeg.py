"""What JPEG costs in the centres of the targets: `python -m benchmarks.jpeg`.

Renders the sample photographs (sample_data/photographs) anew, without flaws and JPEG, fits each
target's X-corner, and fits it again after JPEG at several qualities. The fit is a product of two
error functions with free directions, blur, offset and contrast, in a window of 0.22 of the board.
"""

import sys
from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np
from scipy.optimize import least_squares
from scipy.special import erf

from stereocal.system.array_types import FloatArray
from tools.photographs.rendering import Photograph
from tools.photographs.sample import jpeg, prepare_photographs

QUALITIES = (95, 90, 85, 80, 75, 60)
WINDOW = 0.22
FRAMES = 25


def main() -> None:
    """Print a line for each quality."""
    shifts: dict[int, list[FloatArray]] = {quality: [] for quality in QUALITIES}
    errors: dict[int, list[FloatArray]] = {quality: [] for quality in (100, *QUALITIES)}
    sizes: dict[int, list[int]] = {quality: [] for quality in QUALITIES}
    for image, centres, radii in photographs():
        first = [fitted(image, *place) for place in zip(centres, radii, strict=True)]
        errors[100].extend(first - centres)
        for quality in QUALITIES:
            packed = jpeg(image, quality)
            sizes[quality].append(len(packed))
            stored = np.frombuffer(packed, np.uint8)
            lossy = np.asarray(cv2.imdecode(stored, cv2.IMREAD_UNCHANGED), dtype=np.uint8)
            then = [fitted(lossy, *place) for place in zip(centres, radii, strict=True)]
            shifts[quality].extend(np.array(then) - first)
            errors[quality].extend(then - centres)
    print(f"{len(errors[100])} targets; not packed: error {rms(errors[100]):.4f} px RMS")
    for quality in QUALITIES:
        print(
            f"quality {quality}: {np.mean(sizes[quality]) / 1000:.0f} kB, moved by "
            f"{rms(shifts[quality]):.4f} px RMS, at most {np.abs(shifts[quality]).max():.3f}, "
            f"error {rms(errors[quality]):.4f} px RMS"
        )


def photographs() -> Iterator[tuple[Photograph, FloatArray, FloatArray]]:
    """Each photograph of the sample, the true centres (2, 2), and the windows' radii in px."""
    field = replace(prepare_photographs(0, FRAMES, 1), flaws={})
    depths = [points[:, 2].reshape(-1, 2) for points in field.scene.points_m]
    board = WINDOW * field.bar.board_m
    for i, pair in enumerate(field.pairs()):
        print(f"\rframe {pair.frame} of {FRAMES}", end="", file=sys.stderr, flush=True)
        for image, centres, camera, depth in (
            (pair.primary, pair.centres_primary, field.scene.rig.primary, depths[0][i]),
            (pair.secondary, pair.centres_secondary, field.scene.rig.secondary, depths[1][i]),
        ):
            yield image, centres, camera.K[0, 0] * board / depth
    print(file=sys.stderr)


def fitted(image: Photograph, centre: FloatArray, radius: float) -> FloatArray:
    """The centre (2,) of the X-corner near a place, by least squares."""
    u, v = np.round(centre).astype(int)
    reach = int(radius)
    window = image[v - reach : v + reach + 1, u - reach : u + reach + 1].astype(np.float64)
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]

    def model(p: FloatArray) -> FloatArray:
        edges = [
            erf((np.cos(angle) * (x - p[0]) + np.sin(angle) * (y - p[1])) / p[4])
            for angle in p[2:4]
        ]
        return np.asarray(p[5] + p[6] * edges[0] * edges[1])

    middle, contrast = window.mean(), 2.0 * window.std()
    starts = [
        np.array([0.0, 0.0, angle, angle + between, 1.2, middle, sign * contrast / 2.0])
        for angle in np.deg2rad(np.arange(0, 180, 15))
        for between in np.deg2rad([60, 90, 120])
        for sign in (-1.0, 1.0)
    ]
    best = min(starts, key=lambda start: float(((model(start) - window) ** 2).sum()))

    def residuals(p: FloatArray) -> FloatArray:
        return (model(p) - window).ravel()

    found = least_squares(residuals, best, method="lm").x
    return np.array([u, v]) + np.asarray(found[:2], dtype=np.float64)


def rms(values: list[FloatArray]) -> float:
    """Root of the mean square of all coordinates."""
    return float(np.sqrt(np.mean(np.square(values))))


if __name__ == "__main__":
    main()
