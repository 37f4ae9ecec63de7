"""Common parts of 3D figures: upright axes of equal scale, viewpoints, and the cameras."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import plotly.graph_objects as go

from stereocal.figures.style import GRID_3D, NEUTRAL, TRANSPARENT, add_trace, line_of, upright
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.geometry import AT_ORIGIN, Pose
from stereocal.rig.rig import PlacedCameras
from stereocal.system.array_types import FloatArray

OUTER_VIEWS = ("Behind", "Above", "Side")
VIEWS = (*OUTER_VIEWS, "Camera 1", "Camera 2")
"""Places that the scene of two cameras is seen from; camera 1 is the primary."""
FRUSTUM_OF_DEPTH = 0.15
"""Depth of a drawn camera over the depth of the scene; at its true size it would be a dot."""

HALF_VIEW = 0.414
"""Tangent of half of Plotly's angle of view, from top to bottom."""
WIDE, NARROW = 1.2, 0.75
"""Width over height of a scene across a page, and on a screen of 420 px."""
FILLED = 0.66
"""Part of the view that what is seen may fill: titles of axes and names stand around it."""
CLOSEST = 0.2
"""Least distance of the eye over the scene's diagonal: a single point has no size."""
BEHIND = (0.5, -0.42, -0.76)
"""Behind, right of and above the primary camera."""
AXIS_TITLES = ("x (m)", "z (m), depth", "−y (m), up")
SCENE_AXIS = {
    "showbackground": False,
    "gridcolor": GRID_3D,
    "linecolor": GRID_3D,
    "zeroline": False,
    "showspikes": False,
}
WORLD_TITLES = ("x (m)", "y (m)", "z (m)")
TITLE = {"font": {"size": 14}}
Z_UP = Pose(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]), np.zeros(3))
"""Takes a frame whose z axis points up to one whose y axis points down."""


@dataclass(frozen=True, eq=False)
class SceneFrame:
    """The frame of a scene, whose y axis points down: the primary's, or one of a world frame."""

    from_primary: Pose = AT_ORIGIN
    is_world: bool = False

    @classmethod
    def of_world(cls, world: Pose | None) -> "SceneFrame":
        """The scene of points in a world frame (`world_from_primary`), else in the primary's."""
        return cls() if world is None else cls(Z_UP @ world, True)

    @property
    def words(self) -> tuple[str, str, str]:
        """What is said behind x, y and z of a point."""
        return ("", "", "") if self.is_world else (" (right)", " (down)", " (depth)")

    def points(self, xyz: FloatArray) -> FloatArray:
        """Points (n, 3) of a table, in the scene's frame."""
        return Z_UP.apply(xyz) if self.is_world else xyz

    def place(self, point: FloatArray) -> str:
        """A point (3,) of the scene in words."""
        ours = upright(point) if self.is_world else point
        parts = zip("xyz", ours, self.words, strict=True)
        return ", ".join(f"{name} {value:.3f} m{words}" for name, value, words in parts)


IN_CAMERA = SceneFrame()


@dataclass(frozen=True, eq=False)
class Eye:
    """The place that a scene is seen from, in its frame, metres."""

    direction: npt.ArrayLike = BEHIND
    """(3,): towards the eye, which is as far away as needed to see everything."""
    at: FloatArray | None = None
    """(3,): the eye itself, instead of a direction."""
    towards: FloatArray | None = None
    """(3,): what it then looks at."""
    up: npt.ArrayLike = (0.0, -1.0, 0.0)
    """(3,): what is up in the view."""
    whole: FloatArray | None = None
    """(n, 3): what to see whole; None: everything."""
    shape: float = NARROW
    """Width over height of the view that everything has to fit into."""


def view_names(rig: PlacedCameras) -> tuple[str, ...]:
    """Names of the places that the scene of two cameras or more is seen from."""
    if len(rig.placed) == len(CAMERAS):
        return VIEWS
    return (*OUTER_VIEWS, *(f"Camera {name}" for name in rig.placed))


def eye_of(
    view: str,
    rig: PlacedCameras,
    target: FloatArray,
    scene: SceneFrame = IN_CAMERA,
    whole: FloatArray | None = None,
    shape: float = NARROW,
) -> Eye:
    """One of `view_names` a scene around a point (3,), metres.

    Args:
        scene: in whose frame `target` is given.
        whole, shape: as of `Eye`; `whole` of the first view only.
    """
    turn = scene.from_primary.R
    through = dict(zip(view_names(rig)[len(OUTER_VIEWS) :], rig.placed.values(), strict=True))
    if view in through:
        return Eye(at=scene.from_primary.apply(through[view].pose.inverse().T), towards=target)
    if view == "Above":  # depth to the right, since figures are wide
        return Eye((0.0, -1.0, 0.0), up=-turn[:, 0], shape=shape)
    if view == "Side":
        return Eye(turn[:, 0], shape=shape)
    return Eye(turn @ BEHIND, whole=whole, shape=shape)


def add_cameras(
    figure: go.Figure,
    rig: PlacedCameras,
    depth: float,
    scene: SceneFrame = IN_CAMERA,
    named: bool = True,
) -> None:
    """Draw all frusta in proportion to a depth in metres, with optical centres, which have their
    names if they are in view, and the baseline of two cameras."""
    drawn = frusta(rig, depth, scene)
    centres = np.array([path[0] for _, _, path in drawn])
    # Each name inwards, so that none is cut; above or below, so that they are apart with a short
    # baseline, and not on what is between the cameras.
    across = np.array([placed.pose.inverse().T[0] for placed in rig.placed.values()])
    inwards = np.where(across < across.mean(), "right", "left")
    overs = above_or_below(-centres[:, 1])
    for (name, camera, path), over, side in zip(drawn, overs, inwards, strict=True):
        add_trace(figure, path, line=line_of(width=4), showlegend=False, name=f"{name} camera")
        width, height = camera.image_size
        add_trace(
            figure,
            path[:1],
            f"{name} camera, {width} × {height} px<br>{scene.place(path[0])}",
            marker={"color": NEUTRAL, "size": 5},
            text=[name if named else ""],
            textposition=f"{over} {side}",
            textfont={"size": 14},
            showlegend=False,
            name=f"optical centre, {name}",
        )
    if len(centres) == len(CAMERAS):
        baseline = f"{float(np.linalg.norm(centres[1] - centres[0])):.3f} m"
        line, name = line_of(width=3, dash="dash"), f"Baseline {baseline}"
        add_trace(figure, centres, f"baseline {baseline}", line=line, name=name)


def above_or_below(up: FloatArray) -> list[str]:
    """Where the names of things at heights (n,) stand: above the upper half, below the others."""
    ranks = np.argsort(np.argsort(-up, kind="stable"))
    return ["top" if 2 * rank < len(up) else "bottom" for rank in ranks]


def frusta(
    rig: PlacedCameras, depth: float, scene: SceneFrame = IN_CAMERA
) -> list[tuple[str, Camera, FloatArray]]:
    """Name, camera and outline of each frustum in proportion to a depth in metres.

    An outline is a path (k, 3) with gaps of NaN, which begins at the optical centre.
    """
    return [
        (
            name,
            camera,
            outline_of(camera, scene.from_primary @ pose.inverse(), FRUSTUM_OF_DEPTH * depth),
        )
        for name, (camera, pose) in rig.placed.items()
    ]


def outline_of(camera: Camera, pose: Pose, depth: float) -> FloatArray:
    """A camera's pyramid up to a depth, from its centre round each side of the image."""
    a, b, c, d = pose.apply(depth * np.column_stack([camera.corner_rays, np.ones(4)]))
    gap = np.full(3, np.nan)
    return np.array([pose.T, a, b, pose.T, gap, pose.T, c, d, pose.T, gap, b, c, gap, d, a])


def set_scene(figure: go.Figure, eye: Eye | None = None, scene: SceneFrame = IN_CAMERA) -> None:
    """Set equal axes in metres, and a viewpoint; without one everything is seen from behind."""
    values = [np.concatenate([trace[axis] for trace in figure.data]) for axis in "xyz"]
    ends = np.array([[np.nanmin(v) for v in values], [np.nanmax(v) for v in values]])
    box = ends + 0.02 * np.ptp(ends, axis=0).max() * np.array([[-1.0], [1.0]])
    titles = WORLD_TITLES if scene.is_world else AXIS_TITLES
    common = {**SCENE_AXIS, "nticks": 6, "tickfont": {"size": 12}}
    # Set directly, because `update_layout` takes ten times as long.
    figure.layout.scene = {
        "aspectmode": "data",
        "camera": _view(box, eye or Eye()),
        "bgcolor": TRANSPARENT,
        **{
            f"{axis}axis": {**common, "range": list(ends), "title": {"text": title, **TITLE}}
            for axis, title, ends in zip("xyz", titles, box.T, strict=True)
        },
    }


def _view(box: FloatArray, eye: Eye) -> dict[str, dict[str, float]]:
    """Plotly's camera on a scene in a box (2, 3): its unit is the geometric mean of the axes, its
    origin their middle."""
    middle, unit = box.mean(axis=0), float(np.cbrt(np.prod(np.ptp(box, axis=0))))
    up = upright(eye.up)
    if eye.at is not None and eye.towards is not None:
        place, towards = upright(eye.at), upright(eye.towards)
    else:
        seen, closest_m = box, CLOSEST * float(np.linalg.norm(np.ptp(box, axis=0)))
        if eye.whole is not None:
            seen = np.array([pick(upright(eye.whole), axis=0) for pick in (np.min, np.max)])
        place, towards = _seen_whole(seen, upright(eye.direction), up, closest_m, eye.shape)
    points = {"eye": (place - middle) / unit, "up": up, "center": (towards - middle) / unit}
    return {name: dict(zip("xyz", point.tolist(), strict=True)) for name, point in points.items()}


def _seen_whole(
    box: FloatArray, direction: FloatArray, up: FloatArray, closest_m: float, shape: float
) -> tuple[FloatArray, FloatArray]:
    """The eye (3,) and the point (3,) it looks at, from which a box (2, 3) is seen whole in the
    middle, with room for what is written around it, in a view of a width over height."""
    corners = np.array(np.meshgrid(*box.T)).reshape(3, -1).T
    away = direction / np.linalg.norm(direction)
    across = np.cross(up, away)
    across /= np.linalg.norm(across)
    axes = np.array([across, np.cross(away, across), away])
    seen = corners @ axes.T
    middle = 0.5 * (seen.min(axis=0) + seen.max(axis=0))
    aside, above, nearer = (seen - middle).T
    reach = np.maximum(np.abs(aside) / shape, np.abs(above)) / (HALF_VIEW * FILLED)
    distance = max(float((reach + nearer).max()), closest_m)
    towards = middle @ axes
    return towards + distance * away, towards
