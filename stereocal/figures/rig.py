"""The rig in 3D: two cameras, the baseline between them, and the reconstructed bars.

Drawn in the primary camera's frame with its up direction upwards: (x, z, -y).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import plotly.graph_objects as go

from stereocal.calibration.methods import Errors, Method
from stereocal.errors import StereocalError
from stereocal.figures import space, style
from stereocal.figures.style import METHOD_NAMES, add_trace
from stereocal.fit.results import Calibration
from stereocal.rig.geometry import triangulate_rays
from stereocal.rig.pair import Pair
from stereocal.rig.rig import Rig
from stereocal.system.array_types import BoolArray, FloatArray
from stereocal.system.numbers import count


@dataclass(frozen=True, eq=False)
class RigScene:
    """The data set reconstructed by one method, in the primary camera's frame, metres."""

    dataset: Pair
    rig: Rig
    errors: Errors

    @cached_property
    def points(self) -> FloatArray:
        """(n, 3)."""
        return triangulate_rays(self.rig.pose.R, self.rig.pose.T, self.dataset.rays)

    @cached_property
    def bars(self) -> FloatArray:
        """(m, 2, 3): A and B."""
        return self.points[self.dataset.correspondences.bars]

    @cached_property
    def drawn(self) -> BoolArray:
        """(m,): whether the bars have a length."""
        return np.asarray(np.isfinite(self.bars).all(axis=(1, 2)))

    @cached_property
    def depth(self) -> float:
        """Largest depth of a point; the baseline if there are no points."""
        depths = self.points[np.isfinite(self.points[:, 2]), 2]
        return float(depths.max()) if len(depths) else self.rig.pose.baseline

    @cached_property
    def hover(self) -> dict[int, str]:
        """The hover text of each bar of those in the figure, by its number."""
        frames = self.dataset.correspondences.frame[self.dataset.correspondences.bars[:, 0]]
        lengths = np.linalg.norm(self.bars[:, 0] - self.bars[:, 1], axis=1)
        return {
            k: f"frame {frames[k]}<br>length {lengths[k]:.4f} m, "
            f"error {100 * self.errors.length[k]:.2f} %"
            for k in np.flatnonzero(style.evenly_drawn(len(frames))).tolist()
        }


def scene_of(calibration: Calibration, method: Method) -> RigScene:
    """The bars and the rig of one method."""
    dataset, refined = calibration.dataset, calibration.refined
    if method != "refined":
        rig = Rig(dataset.primary, dataset.secondary, calibration.methods[method].pose)
    elif refined is None:
        raise StereocalError("There is no refined set.")
    else:
        rig = Rig(refined.primary, refined.secondary, refined.pose)
        dataset = refined.apply(dataset)
    return RigScene(dataset, rig, calibration.errors[method])


def plot_rig(
    calibration: Calibration, method: Method, view: str = space.VIEWS[0], narrow: bool = False
) -> go.Figure:
    """The rig and the bars reconstructed by one method; equal axes, metres.

    Args:
        view: one of `VIEWS`.
        narrow: for a screen of 420 px.
    """
    scene, figure = scene_of(calibration, method), style.blank(520)
    # One trace for all bars: A, centre, B, gap; the centre is a hover point.
    shown = [k for k in scene.hover if scene.drawn[k]]
    ends, missing = scene.bars[shown], int((~scene.drawn).sum())
    number = style.n_drawn(int(scene.drawn.sum()))
    number += f", {missing} behind a camera" if missing else ""
    add_trace(
        figure,
        style.with_gaps(np.insert(ends, 1, ends.mean(axis=1), axis=1)),
        "%{text}",
        mode="lines",
        line={"color": style.METHOD_COLOURS[method], "width": 4},
        text=np.repeat([scene.hover[k] for k in shown], 4),
        name=f"Bars, {METHOD_NAMES[method]} ({number})",
    )
    _add_targets(figure, scene)
    space.add_cameras(figure, scene.rig, scene.depth)
    bars = scene.bars[scene.drawn].reshape(-1, 3)
    target = bars.mean(axis=0) if len(bars) else np.array([0.0, 0.0, scene.depth])
    shape = space.NARROW if narrow else space.WIDE
    space.set_scene(figure, space.eye_of(view, scene.rig, target, shape=shape))
    return figure


def describe_rig(calibration: Calibration, method: Method) -> str:
    """Where the secondary camera is, and the reconstructed bars."""
    scene = scene_of(calibration, method)
    x, y, z = scene.rig.pose.inverse().T
    text = (
        f"The rig with the {METHOD_NAMES[method]}: the secondary camera is "
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
    if missing := int((~scene.drawn).sum()):
        text += f"; {count(missing, 'bar')} not drawn (point behind a camera)"
    return text + "."


def _add_targets(figure: go.Figure, scene: RigScene) -> None:
    rows = scene.dataset.correspondences
    alone = np.setdiff1d(np.arange(len(rows)), rows.bars)
    without = "no bar: the other target is missing"
    if rows.rigid_object is not None:
        without = "end of no known distance"
    of_bar = dict.fromkeys(alone[style.evenly_drawn(len(alone))].tolist(), without)
    for k, text in scene.hover.items():
        of_bar.update(dict.fromkeys(rows.bars[k].tolist(), text))
    drawn = np.isin(np.arange(len(rows)), list(of_bar)) & np.isfinite(scene.points[:, 0])
    size = 2.5 if len(rows.frames) <= 100 else 1.5
    for target, of, colour, symbol in style.marks_of(rows):
        of_target = np.flatnonzero(drawn & of)
        add_trace(
            figure,
            scene.points[of_target],
            f"target {target}, %{{text}}<br>x %{{x:.3f}} m (right), "
            "y %{customdata:.3f} m (down), z %{y:.3f} m (depth)",
            mode="markers",
            marker={"color": colour, "symbol": symbol, "size": size},
            text=[of_bar[row] for row in of_target.tolist()],
            customdata=scene.points[of_target, 1],
            name=f"Target {target}",
        )
