"""Common parts of 3D figures: upright axes of equal scale, viewpoints, and the two cameras."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
import plotly.graph_objects as go

from stereocal.figures.style import GRID_3D, NEUTRAL, TRANSPARENT
from stereocal.rig.camera import Camera
from stereocal.rig.compiled import FloatArray
from stereocal.rig.geometry import Pose
from stereocal.rig.rig import Rig

VIEWS = ("Behind", "Above", "Side", "Camera 1", "Camera 2")
"""From where the scene is seen; camera 1 is the primary."""
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
AXIS_TITLES = {"xaxis": "x (m)", "yaxis": "z (m), depth", "zaxis": "−y (m), up"}
SCENE_AXIS = {
    "showbackground": False,
    "gridcolor": GRID_3D,
    "linecolor": GRID_3D,
    "zeroline": False,
    "showspikes": False,
}
WORLD_TITLES = {"xaxis": "x (m)", "yaxis": "y (m)", "zaxis": "z (m)"}
Z_UP = Pose(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]), np.zeros(3))
"""From a frame whose z axis points up to one whose y axis points down."""


@dataclass(frozen=True, eq=False)
class Scene:
    """The frame of a scene, whose y axis points down: the primary's, or one of a world frame."""

    from_primary: Pose = field(default_factory=lambda: Pose(np.eye(3), np.zeros(3)))
    is_world: bool = False

    @classmethod
    def of_world(cls, world: Pose | None) -> Scene:
        """The scene of points in a world frame (`world_from_primary`), else in the primary's."""
        return cls() if world is None else cls(Z_UP @ world, True)

    @property
    def titles(self) -> Mapping[str, str]:
        """Of the figure's axes."""
        return WORLD_TITLES if self.is_world else AXIS_TITLES

    def points(self, xyz: FloatArray) -> FloatArray:
        """Points (n, 3) of a table, in the scene's frame."""
        return Z_UP.apply(xyz) if self.is_world else xyz

    def place(self, point: FloatArray) -> str:
        """A point (3,) of the scene in words."""
        x, y, z = _upright(point) if self.is_world else point
        if self.is_world:
            return f"x {x:.3f} m, y {y:.3f} m, z {z:.3f} m"
        return f"x {x:.3f} m (right), y {y:.3f} m (down), z {z:.3f} m (depth)"


IN_CAMERA = Scene()


def upright(points: FloatArray) -> dict[str, FloatArray]:
    """Points (..., 3) in the primary's frame, as the figure's coordinates: x, depth, up."""
    return {"x": points[..., 0].ravel(), "y": points[..., 2].ravel(), "z": -points[..., 1].ravel()}


@dataclass(frozen=True, eq=False)
class Eye:
    """From where a scene is seen, in the primary's frame, metres."""

    direction: tuple[float, float, float] = BEHIND
    """Towards the eye, which is as far away as needed to see everything."""
    at: FloatArray | None = None
    """(3,): the eye itself, instead of a direction."""
    towards: FloatArray | None = None
    """(3,): what it then looks at."""
    up: tuple[float, float, float] = (0.0, -1.0, 0.0)
    """What is up in the view."""
    whole: FloatArray | None = None
    """(n, 3): what to see whole; None: everything."""
    shape: float = NARROW
    """Width over height of the view that everything has to fit into."""


def eye_of(
    view: str,
    rig: Rig,
    target: FloatArray,
    scene: Scene = IN_CAMERA,
    whole: FloatArray | None = None,
) -> Eye:
    """One of `VIEWS` of a scene around a point (3,), metres.

    Args:
        scene: in whose frame `target` is given.
        whole: (n, 3): what the first view shows whole; None: everything.
    """
    if view.startswith("Camera"):
        second = scene.from_primary.apply(rig.pose.inverse().T)
        return Eye(at=scene.from_primary.T if view == "Camera 1" else second, towards=target)
    if view == "Above":  # depth to the right, since figures are wide
        return Eye((0.0, -1.0, 0.0), up=_turned(scene, (-1.0, 0.0, 0.0)))
    if view == "Side":
        return Eye(_turned(scene, (1.0, 0.0, 0.0)))
    return Eye(_turned(scene, BEHIND), whole=whole)


def _turned(scene: Scene, direction: tuple[float, float, float]) -> tuple[float, float, float]:
    x, y, z = (scene.from_primary.R @ direction).tolist()
    return x, y, z


def add_cameras(figure: go.Figure, rig: Rig, depth: float, scene: Scene = IN_CAMERA) -> None:
    """Draw both frusta with labelled optical centres, and the baseline.

    Args:
        depth: of the scene, metres: the frusta are drawn in proportion.
        scene: in whose frame they are drawn.
    """
    # One name above, one below, each inwards: apart with a short baseline, and not cut.
    inwards = ("right", "left") if rig.pose.inverse().T[0] > 0 else ("left", "right")
    for (name, camera, path), over, side in zip(
        frusta(rig, depth, scene), ("top", "bottom"), inwards, strict=True
    ):
        centre = path[0]
        figure.add_scatter3d(
            **upright(path),
            mode="lines",
            line={"color": NEUTRAL, "width": 4},
            hoverinfo="skip",
            showlegend=False,
            name=f"{name} camera",
        )
        width, height = camera.image_size
        figure.add_scatter3d(
            **upright(centre),
            mode="markers+text",
            text=[name],
            textposition=f"{over} {side}",
            marker={"color": NEUTRAL, "size": 5},
            textfont={"size": 14},
            showlegend=False,
            hovertemplate=f"{name} camera, {width} × {height} px<br>"
            f"{scene.place(centre)}<extra></extra>",
            name=f"optical centre, {name}",
        )
    length = f"{rig.pose.baseline:.3f} m"
    figure.add_scatter3d(
        **upright(np.array([scene.from_primary.T, _secondary_in(scene, rig).T])),
        mode="lines",
        line={"color": NEUTRAL, "width": 3, "dash": "dash"},
        hovertemplate=f"baseline {length}<extra></extra>",
        name=f"Baseline {length}",
    )


def frusta(
    rig: Rig, depth: float, scene: Scene = IN_CAMERA
) -> Iterator[tuple[str, Camera, FloatArray]]:
    """Name, camera and outline of each frustum in proportion to a depth in metres.

    An outline is a path (k, 3) with gaps of NaN, which begins at the optical centre.
    """
    for name, camera, pose in (
        ("primary", rig.primary, scene.from_primary),
        ("secondary", rig.secondary, _secondary_in(scene, rig)),
    ):
        yield name, camera, outline_of(camera, pose, FRUSTUM_OF_DEPTH * depth)


def outline_of(camera: Camera, pose: Pose, depth: float) -> FloatArray:
    """A camera's pyramid up to a depth, from its centre round each side of the image."""
    a, b, c, d = pose.apply(depth * np.column_stack([camera.corner_rays, np.ones(4)]))
    gap = np.full(3, np.nan)
    return np.array([pose.T, a, b, pose.T, gap, pose.T, c, d, pose.T, gap, b, c, gap, d, a])


def _secondary_in(scene: Scene, rig: Rig) -> Pose:
    """The secondary camera in the frame of a scene."""
    return scene.from_primary @ rig.pose.inverse()


def set_scene(figure: go.Figure, eye: Eye | None = None, scene: Scene = IN_CAMERA) -> None:
    """Set equal axes in metres, and a viewpoint; without one everything is seen from behind."""
    low, high = _bounds(figure)
    # Set directly, because `update_layout` takes ten times as long.
    figure.layout.scene = {
        "aspectmode": "data",
        "camera": _view(low, high, eye),
        "bgcolor": TRANSPARENT,
        **{
            name: {
                **SCENE_AXIS,
                "nticks": 6,
                "tickfont": {"size": 12},
                "range": [low[at], high[at]],
                "title": {"text": title, "font": {"size": 14}},
            }
            for at, (name, title) in enumerate(scene.titles.items())
        },
    }


def _bounds(figure: go.Figure) -> tuple[FloatArray, FloatArray]:
    """(3,) each: the ranges of the axes, with a margin of 2 % of the largest."""
    values = [np.concatenate([trace[axis] for trace in figure.data]) for axis in "xyz"]
    known = [each[np.isfinite(each)] for each in values]
    low, high = (np.array([pick(each) for each in known]) for pick in (np.min, np.max))
    margin = 0.02 * (high - low).max()
    return low - margin, high + margin


def _view(low: FloatArray, high: FloatArray, eye: Eye | None) -> dict[str, dict[str, float]]:
    """Plotly's camera. Its unit is the geometric mean of the axes, its origin their middle."""
    middle, unit = 0.5 * (low + high), float(np.cbrt(np.prod(high - low)))
    eye = eye or Eye()
    if eye.at is not None and eye.towards is not None:
        at, towards = _upright(eye.at), _upright(eye.towards)
    else:
        box = (low, high)
        if eye.whole is not None:
            some = upright(eye.whole)
            box = (
                np.array([some[axis].min() for axis in "xyz"]),
                np.array([some[axis].max() for axis in "xyz"]),
            )
        direction, up = (_upright(np.array(each)) for each in (eye.direction, eye.up))
        closest_m = CLOSEST * float(np.linalg.norm(high - low))
        at, towards = _seen_whole(box, direction, up, closest_m, eye.shape)
    names = ("x", "y", "z")
    return {
        "eye": dict(zip(names, ((at - middle) / unit).tolist(), strict=True)),
        "up": dict(zip(names, _upright(np.array(eye.up)).tolist(), strict=True)),
        "center": dict(zip(names, ((towards - middle) / unit).tolist(), strict=True)),
    }


def _seen_whole(
    box: tuple[FloatArray, FloatArray],
    direction: FloatArray,
    up: FloatArray,
    closest_m: float,
    shape: float,
) -> tuple[FloatArray, FloatArray]:
    """The eye (3,) and the point (3,) it looks at, from which a box is seen whole in the middle.

    With room for what is written around the box.

    Args:
        shape: width over height of the view.
    """
    corners = np.array(np.meshgrid(*zip(*box, strict=True))).reshape(3, -1).T
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


def _upright(point: FloatArray) -> FloatArray:
    return np.array([point[0], point[2], -point[1]])
