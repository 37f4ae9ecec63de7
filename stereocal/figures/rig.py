"""The rig in 3D: two cameras, the baseline between them, and the reconstructed bars.

Drawn in the primary camera's frame with its up direction upwards: (x, z, -y).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt
import plotly.graph_objects as go

from stereocal.calibration.methods import ALL_METHODS, Method
from stereocal.calibration.results import Errors
from stereocal.errors import StereocalError
from stereocal.figures.space import NARROW, VIEWS, WIDE, add_cameras, eye_of, set_scene, upright
from stereocal.figures.style import (
    METHOD_COLOURS,
    METHOD_NAMES,
    count,
    evenly_drawn,
    finish,
    marks_of,
    n_drawn,
)
from stereocal.refined.results import Calibration
from stereocal.rig.compiled import FloatArray
from stereocal.rig.dataset import Dataset
from stereocal.rig.geometry import triangulate_rays
from stereocal.rig.rig import Rig

HEIGHT = 520


@dataclass(frozen=True, eq=False)
class RigScene:
    """The data set reconstructed by one method, in the primary camera's frame."""

    dataset: Dataset
    rig: Rig
    errors: Errors

    @cached_property
    def points(self) -> FloatArray:
        """(n, 3), metres."""
        return triangulate_rays(self.rig.pose.R, self.rig.pose.T, self.dataset.rays)

    @cached_property
    def bars(self) -> FloatArray:
        """(m, 2, 3), metres: A and B."""
        return self.points[self.dataset.correspondences.bars]

    @cached_property
    def lengths(self) -> FloatArray:
        """(m,), metres."""
        lengths: FloatArray = np.linalg.norm(self.bars[:, 0] - self.bars[:, 1], axis=1)
        return lengths

    @cached_property
    def drawn(self) -> npt.NDArray[np.bool_]:
        """(m,): whether the bars have a length."""
        return np.isfinite(self.lengths)

    @cached_property
    def depth(self) -> float:
        """Largest depth of a point, in metres; the baseline if there are no points."""
        depths = self.points[np.isfinite(self.points[:, 2]), 2]
        return float(depths.max()) if len(depths) else self.rig.pose.baseline

    @cached_property
    def secondary_centre(self) -> FloatArray:
        """(3,), metres."""
        return self.rig.pose.inverse().T

    @cached_property
    def hover(self) -> dict[int, str]:
        """The hover text of each bar with a length, of those in the figure, by its number."""
        frames = self.dataset.correspondences.frame[self.dataset.correspondences.bars[:, 0]]
        return {
            k: f"frame {frames[k]}<br>length {self.lengths[k]:.4f} m, "
            f"error {100 * self.errors.length[k]:.2f} %"
            for k in np.flatnonzero(evenly_drawn(len(frames))).tolist()
        }


def plot_rig(
    calibration: Calibration, method: str, view: str = VIEWS[0], narrow: bool = False
) -> go.Figure:
    """The rig and the bars reconstructed by one method; equal axes, metres.

    Args:
        view: one of `VIEWS`.
        narrow: for a screen of 420 px.
    """
    chosen = _method(method)
    scene = scene_of(calibration, chosen)
    figure = finish(go.Figure(), HEIGHT)
    _add_bars(figure, scene, chosen)
    _add_targets(figure, scene)
    add_cameras(figure, scene.rig, scene.depth)
    bars = scene.bars[scene.drawn].reshape(-1, 3)
    target = bars.mean(axis=0) if len(bars) else np.array([0.0, 0.0, scene.depth])
    eye = eye_of(view, scene.rig, target)
    set_scene(figure, replace(eye, shape=NARROW if narrow else WIDE))
    return figure


def describe_rig(calibration: Calibration, method: str) -> str:
    """The figure in words."""
    chosen = _method(method)
    scene = scene_of(calibration, chosen)
    x, y, z = scene.secondary_centre
    text = (
        f"The rig with the {METHOD_NAMES[chosen]}: the secondary camera is "
        f"{scene.rig.pose.baseline:.3f} m from the primary, {abs(x):.2f} m to the "
        f"{'right' if x >= 0 else 'left'}, {abs(y):.2f} m {'down' if y >= 0 else 'up'} and "
        f"{abs(z):.2f} m {'forward' if z >= 0 else 'back'} in the primary's view"
    )
    if scene.drawn.any():
        depths = scene.bars[scene.drawn][..., 2]
        text += (
            f"; {count(int(scene.drawn.sum()), 'bar')} at depths from {depths.min():.2f} to "
            f"{depths.max():.2f} m, with a mean length error of "
            f"{100 * scene.errors.mean_length:.2f} %"
        )
    missing = int((~scene.drawn).sum())
    if missing:
        text += f"; {count(missing, 'bar')} not drawn (point behind a camera)"
    return text + "."


def _method(name: str) -> Method:
    for method in ALL_METHODS:
        if method == name:
            return method
    raise StereocalError(f'The method "{name}" is not known: {", ".join(ALL_METHODS)}.')


def scene_of(calibration: Calibration, method: Method) -> RigScene:
    """The bars and the rig of one method."""
    dataset = calibration.dataset
    if method != "refined":
        rig = Rig(dataset.primary, dataset.secondary, calibration.methods[method].pose)
        return RigScene(dataset, rig, calibration.errors[method])
    refined = calibration.refined
    if refined is None:
        raise StereocalError("There is no refined set.")
    rig = Rig(refined.primary, refined.secondary, refined.pose)
    return RigScene(refined.apply(dataset), rig, calibration.errors["refined"])


def _add_bars(figure: go.Figure, scene: RigScene, method: Method) -> None:
    """One trace for all bars: A, centre, B, gap; the centre is a hover point."""
    shown = [k for k in scene.hover if scene.drawn[k]]
    bars = scene.bars[shown]
    path = np.full((len(bars), 4, 3), np.nan)
    path[:, 0], path[:, 1], path[:, 2] = bars[:, 0], bars.mean(axis=1), bars[:, 1]
    texts = [scene.hover[k] for k in shown]
    missing = int((~scene.drawn).sum())
    figure.add_scatter3d(
        **upright(path),
        mode="lines",
        line={"color": METHOD_COLOURS[method], "width": 4},
        text=np.repeat(texts, 4),
        hovertemplate="%{text}<extra></extra>",
        name=f"Bars, {METHOD_NAMES[method]} ({n_drawn(int(scene.drawn.sum()))}"
        + (f", {missing} behind a camera)" if missing else ")"),
    )


def _add_targets(figure: go.Figure, scene: RigScene) -> None:
    rows = scene.dataset.correspondences
    is_bar = rows.rigid_object is None
    alone = np.setdiff1d(np.arange(len(rows)), rows.bars)
    of_bar = dict.fromkeys(
        alone[evenly_drawn(len(alone))].tolist(),
        "no bar: the other target is missing" if is_bar else "end of no known distance",
    )
    for k, text in scene.hover.items():
        of_bar.update(dict.fromkeys(rows.bars[k].tolist(), text))
    drawn = np.zeros(len(rows), dtype=np.bool_)
    drawn[list(of_bar)] = True
    for target, of, colour, symbol in marks_of(rows):
        of_target = np.flatnonzero(drawn & of & np.isfinite(scene.points[:, 0]))
        points = scene.points[of_target]
        figure.add_scatter3d(
            **upright(points),
            mode="markers",
            marker={
                "color": colour,
                "symbol": symbol,
                "size": 2.5 if len(rows.frames) <= 100 else 1.5,
            },
            text=[of_bar[row] for row in of_target.tolist()],
            customdata=points[:, 1],
            hovertemplate=(
                f"target {target}, %{{text}}<br>x %{{x:.3f}} m (right), "
                "y %{customdata:.3f} m (down), z %{y:.3f} m (depth)<extra></extra>"
            ),
            name=f"Target {target}",
        )
