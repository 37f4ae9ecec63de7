"""Render photographs of flat boards with the full lens model.

A board is a grid of cells with one grey level each. The cells are averaged over the area of each
pixel (`area_sampling`), so that corners appear exactly where `Camera.project` puts them, without a
bias from the pixel grid.

Grey levels are 0 to 255, independent of the bit depth.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
from scipy.interpolate import RectBivariateSpline

from stereocal.errors import StereocalError
from stereocal.rig.camera import Camera
from stereocal.rig.geometry import Pose
from stereocal.rig.window import rays_through
from stereocal.system.array_types import FloatArray
from tools.photographs.area_sampling import (
    BLUR_REACH,
    fill_parts,
    pixel_weights,
    sample_offsets,
    sum_parts,
)

Picture = npt.NDArray[np.float32]
"""(height, width) grey levels before the sensor; 255 is full scale."""
Rays = Callable[[npt.NDArray[np.floating], npt.NDArray[np.floating]], FloatArray]
"""Normalised x or y (rows, columns) as a function of ascending rows and columns in pixels."""
OnBoard = Callable[
    [npt.NDArray[np.floating], npt.NDArray[np.floating]], tuple[FloatArray, FloatArray]
]
"""Coordinates x and y (rows, columns) on a board, in metres, seen at rows and columns of pixels;
NaN where its plane is not seen."""
Photograph = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]

HERE = Pose(np.eye(3), np.zeros(3))
"""The primary camera's pose in its own frame."""
WHITE_LEVEL = 255.0
STRIP_ROWS = 64
"""Rows rendered at once, so that the parts stay in the processor's cache."""
PARTS_TIMES_BLUR = 2.8
"""Parts per pixel times blur in pixels: an edge blurred by 0.8 px is accurate to 0.3 %."""
MAXIMUM_PARTS = 8
NODE_PX = 16.0
"""Spacing of the pixels that are undistorted by Newton's method; cubic splines interpolate between
them. The error is 2e-4 px for a wide lens (f = 500 px, k1 = -0.3), and far less for a long one."""


@dataclass(frozen=True, eq=False)
class Board:
    """A flat board: a grid of cells with one grey level each.

    Its frame in metres: origin in the centre, x right along the rows of cells, y down, z away from
    the viewer. Seen upright and frontally, its pose has R = I.
    """

    cells: FloatArray
    """(rows, columns) grey levels."""
    size_m: tuple[float, float]
    """Width and height in metres."""


@dataclass(frozen=True, eq=False)
class Placed:
    """A board and its pose."""

    board: Board
    camera_from_board: Pose

    def seen_from(self, camera_from_here: Pose) -> "Placed":
        """The same board in the frame of another camera."""
        return Placed(self.board, camera_from_here @ self.camera_from_board)


@dataclass(frozen=True)
class PhotographSettings:
    """Optics and sensor."""

    blur_px: float = 0.8
    """Standard deviation of the Gaussian optical blur, in px, without the pixel area."""
    vignetting: float = 0.15
    """Fraction of the intensity lost in the corners; it grows with the radius squared."""
    full_well_e: float = 10_000.0
    """Electrons at grey level 255, which determine the photon noise; infinite for none."""
    read_noise: float = 0.8
    """Standard deviation of the read noise, in grey levels (of 255)."""
    bits: int = 8
    """Bit depth; above 8 the photograph has 16-bit values from 0 to 2**bits - 1."""


def x_corner_board(
    size_m: float, black: float = 35.0, white: float = 205.0, black_first: bool = True
) -> Board:
    """A 2x2 checkerboard with this side: one X-corner, at its origin; black top left, or white."""
    first, second = (black, white) if black_first else (white, black)
    return Board(np.array([[first, second], [second, first]]), (size_m, size_m))


def chessboard(
    squares: tuple[int, int], square_m: float, black: float = 35.0, white: float = 205.0
) -> Board:
    """A chessboard of (columns, rows) squares, black top left, with a white border of one square.

    Its inner corners: `chessboard_corners`.
    """
    columns, rows = squares
    cells = np.full((rows + 2, columns + 2), white)
    cells[1:-1, 1:-1] = np.where(
        np.add.outer(np.arange(rows), np.arange(columns)) % 2, white, black
    )
    return Board(cells, ((columns + 2) * square_m, (rows + 2) * square_m))


def chessboard_corners(squares: tuple[int, int], square_m: float) -> FloatArray:
    """Inner corners, (n, 3) in the board's frame, row by row from the top left."""
    x, y = np.meshgrid(*((np.arange(1, n) - 0.5 * n) * square_m for n in squares))
    return np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])


def turned(rotation_vector: npt.ArrayLike) -> FloatArray:
    """The rotation matrix (3, 3) of a rotation vector (3,) in radians."""
    R, _ = cv2.Rodrigues(np.asarray(rotation_vector, dtype=np.float64))
    return np.asarray(R, dtype=np.float64)


def photograph(
    camera: Camera,
    background: Picture | float,
    boards: Iterable[Placed],
    settings: PhotographSettings,
    rng: np.random.Generator,
) -> Photograph:
    """Render a photograph of boards in front of a background.

    Args:
        background: (height, width) grey levels before the optical blur, or one grey level.
        boards: from the farthest to the nearest.

    Returns:
        (height, width), uint8, or uint16 for more than 8 bits.
    """
    return expose(exposed(camera, HERE, background, [boards], settings.blur_px), settings, rng)


def exposed(
    camera: Camera,
    camera_from_here: Pose,
    background: Picture | float,
    exposure: Sequence[Iterable[Placed]],
    blur_px: float,
) -> Picture:
    """The image on the sensor: the mean over the steps of an exposure."""
    empty = np.full(camera.image_size[::-1], background, dtype=np.float32)
    if np.ndim(background):
        empty = blurred(empty, blur_px)
    picture = np.zeros_like(empty)
    for boards in exposure:
        shot = empty.copy()
        for placed in boards:
            paint(shot, camera, placed.seen_from(camera_from_here), blur_px)
        picture += shot / np.float32(len(exposure))
    return picture


def paint(picture: Picture, camera: Camera, placed: Placed, blur_px: float) -> None:
    """Draw a board with blur over a picture, or over all channels of one in colour, in place.

    A board seen from behind has a uniform grey level.
    """
    box = _box(camera, placed, BLUR_REACH * blur_px + 1.0)
    if box is None:
        return
    left, top, right, bottom = box
    parts = int(np.clip(np.ceil(PARTS_TIMES_BLUR / max(blur_px, 0.01)), 2, MAXIMUM_PARTS))
    weights = pixel_weights(blur_px, parts)
    pad = (len(weights) // parts - 1) // 2
    columns = np.arange(left - pad, right + pad + 1) - 0.5
    every_row = np.arange(top - pad, bottom + pad + 1) - 0.5
    pose = placed.camera_from_board
    on_board = _on_board(camera, pose, columns, every_row)
    cells = placed.board.cells
    if pose.R[:, 2] @ pose.T <= 0:
        cells = np.full_like(cells, cells.mean())
    per_metre = np.array(cells.shape[::-1]) / placed.board.size_m
    middle = 0.5 * np.array(cells.shape[::-1])
    offsets = sample_offsets()
    for start in range(top, bottom, STRIP_ROWS):
        stop = min(start + STRIP_ROWS, bottom)
        rows = np.arange(start - pad, stop + pad + 1) - 0.5
        s, t = on_board(rows, columns)
        s, t = s * per_metre[0] + middle[0], t * per_metre[1] + middle[1]
        fine = np.empty((2, (len(rows) - 1) * parts, (len(columns) - 1) * parts), dtype=np.float32)
        fill_parts(s, t, cells, offsets, parts, fine)
        grey, cover = (sum_parts(layer, weights, parts) for layer in fine)
        for channel in np.atleast_3d(picture[start:stop, left:right]).transpose(2, 0, 1):
            channel += grey - cover * channel


def expose(picture: Picture, settings: PhotographSettings, rng: np.random.Generator) -> Photograph:
    """The sensor's output: vignetting, noise, quantisation.

    Photon noise is normal with the variance of the Poisson distribution, a good approximation even
    at a grey level of 5 (200 of 10,000 electrons).
    """
    height, width = picture.shape
    x2, y2 = (np.linspace(-1.0, 1.0, n, dtype=np.float32) ** 2 * n**2 for n in (width, height))
    lost = np.float32(settings.vignetting / (width**2 + height**2))
    intensity = picture * (1.0 - lost * (x2 + y2[:, None]))
    variance = intensity * np.float32(WHITE_LEVEL / settings.full_well_e)
    np.maximum(variance, 0.0, out=variance)
    variance += np.float32(settings.read_noise**2)
    intensity += np.sqrt(variance) * rng.standard_normal(intensity.shape, dtype=np.float32)
    highest = 2**settings.bits - 1
    intensity *= np.float32(highest / WHITE_LEVEL)
    np.rint(intensity, out=intensity)
    np.clip(intensity, 0, highest, out=intensity)
    if settings.bits == 8:
        return np.asarray(intensity, dtype=np.uint8)
    return np.asarray(intensity, dtype=np.uint16)


def blurred(picture: Picture, blur_px: float) -> Picture:
    """The picture after a Gaussian blur, with mirrored borders."""
    if blur_px == 0:
        return picture.copy()
    soft = cv2.GaussianBlur(picture, (0, 0), blur_px, borderType=cv2.BORDER_REFLECT_101)
    return np.asarray(soft, dtype=np.float32)


def _box(camera: Camera, placed: Placed, reach: float) -> tuple[int, int, int, int] | None:
    """Left, top, right and bottom of the blurred board in the image; None if outside."""
    width, height = camera.image_size
    points = placed.camera_from_board.apply(outline_of(np.array(placed.board.size_m), 17))
    if not (camera.seen_in_air(points)[:, 2] > 0).all():
        raise StereocalError("A board is not completely in front of its camera and its window.")
    pixels = pixels_of(camera, points)
    if pixels is None:
        return 0, 0, width, height
    low, high = pixels.min(axis=0) - reach, pixels.max(axis=0) + reach
    left, top = (int(v) for v in np.clip(np.floor(low), 0, [width, height]))
    right, bottom = (int(v) for v in np.clip(np.ceil(high) + 1, 0, [width, height]))
    return (left, top, right, bottom) if left < right and top < bottom else None


def outline_of(size_m: FloatArray, points: int) -> FloatArray:
    """(4 points, 3): on the edge of a board, in its frame."""
    along = np.linspace(-0.5, 0.5, points)
    ends = np.full_like(along, 0.5)
    sides = (along, ends), (along, -ends), (ends, along), (-ends, along)
    outline = np.concatenate([np.column_stack(side) for side in sides]) * size_m
    return np.column_stack([outline, np.zeros(len(outline))])


def pixels_of(camera: Camera, points: FloatArray) -> FloatArray | None:
    """Pixels (n, 2) of points; None where one is so far outside the view that the distortion
    polynomial folds back."""
    pixels, in_air = camera.project(points), camera.seen_in_air(points)
    back = np.abs(camera.undistort(pixels) - in_air[:, :2] / in_air[:, 2:])
    return pixels if (back < 1e-6).all() else None


def pixel_ray(camera: Camera, pixel: FloatArray) -> FloatArray:
    """The point (3,) at depth 1 that a raw pixel (2,) sees."""
    return np.append(camera.undistort(pixel)[0], 1.0)


def ray_splines(
    camera: Camera, columns: npt.NDArray[np.floating], rows: npt.NDArray[np.floating]
) -> tuple[Rays, Rays]:
    """Normalised x and y; of a fisheye, which has rays in a part of the image only, of each pixel.
    Before a window they are those in air.

    Args:
        columns, rows: ascending pixel coordinates; the splines are valid from first to last.
    """

    def rays(of: npt.NDArray[np.floating], at: npt.NDArray[np.floating]) -> FloatArray:
        grid = np.stack(np.meshgrid(at, of), axis=-1)
        return camera.undistort(grid.reshape(-1, 2)).reshape(grid.shape)

    if camera.is_fisheye:
        return lambda of, at: rays(of, at)[..., 0], lambda of, at: rays(of, at)[..., 1]
    v, u = (
        np.linspace(values[0], values[-1], max(4, int(np.ceil(np.ptp(values) / NODE_PX)) + 1))
        for values in (rows, columns)
    )
    between = rays(v, u)
    x, y = (RectBivariateSpline(v, u, between[..., i]) for i in range(2))
    return x, y


def _on_board(
    camera: Camera, pose: Pose, columns: npt.NDArray[np.floating], rows: npt.NDArray[np.floating]
) -> OnBoard:
    """Where the rays of the camera meet the plane of a board; behind a window, those that leave its
    wet face (as of `Camera.rays_from`).

    Args:
        columns, rows: as of `ray_splines`.
    """
    x, y = ray_splines(camera, columns, rows)
    window = camera.window
    if window is None:
        board_from_ray = np.linalg.inv(np.column_stack([pose.R[:, :2], pose.T]))
        return lambda of, at: on_plane(x(of, at), y(of, at), board_from_ray)

    def behind(
        of: npt.NDArray[np.floating], at: npt.NDArray[np.floating]
    ) -> tuple[FloatArray, FloatArray]:
        in_air = np.stack([x(of, at), y(of, at), np.ones((len(of), len(at)))], axis=-1)
        origins, directions = rays_through(window, in_air.reshape(-1, 3))
        from_board, along = (origins - pose.T) @ pose.R, directions @ pose.R
        ahead = -from_board[:, 2] / along[:, 2]
        ahead[~(ahead > 0.0)] = np.nan
        s, t = (from_board[:, :2] + ahead[:, None] * along[:, :2]).T.reshape(2, len(of), len(at))
        return s, t

    return behind


def on_plane(
    x: FloatArray, y: FloatArray, plane_from_ray: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Intersections of rays with a plane: x and y in its frame; NaN if not in front of the camera.

    Args:
        x, y: normalised image coordinates, of any equal shape.
        plane_from_ray: (3, 3), the inverse of `[r1 r2 T]` of the plane's pose.
    """
    across, down, scale = (h[0] * x + h[1] * y + h[2] for h in plane_from_ray)
    scale[scale <= 0] = np.nan
    return across / scale, down / scale
