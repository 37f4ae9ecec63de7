"""A pair of a rig: its refined parameter file, and its data with the rig's lenses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stereocal.network.fuse import pair_covariance
from stereocal.network.result import RigCalibration
from stereocal.refined.parameter_file import covariance_entry
from stereocal.rig.dataset import Dataset
from stereocal.rig.parameters import RigParameters, inputs_of
from stereocal.rig.recording import Pair
from stereocal.rig.rig import Rig
from stereocal.rig.volume import Volume


def pair_name(pair: Pair) -> str:
    """Such as `left-right`."""
    return "-".join(pair)


def pair_dataset(rig: RigCalibration, pair: Pair) -> Dataset:
    """The frames that the rig was fitted to, of two cameras with the rig's lenses and baseline."""
    found = rig.recording.pair(*pair)
    frames = rig.fit.frames[rig.used]
    return replace(
        found.of_frames(frames[np.isin(frames, found.correspondences.frames)]),
        primary=rig.cameras[pair[0]],
        secondary=rig.cameras[pair[1]],
        baseline_m=rig.pose_of(pair).baseline,
    )


def pair_parameters(rig: RigCalibration, pair: Pair) -> RigParameters:
    """The refined file of a pair, from the rig."""
    dataset = pair_dataset(rig, pair)
    pose = rig.pose_of(pair)
    own = Rig(dataset.primary, dataset.secondary, pose)
    numbers = rig.names.index(pair[0]), rig.names.index(pair[1])
    covariance = pair_covariance(own, *numbers, rig.fit.q, rig.fit.R, rig.covariance)
    rows, noise = dataset.correspondences, float(rig.fit.sigma_px)
    points = own.reconstruct(rows.primary, rows.secondary)
    return RigParameters(
        method="refined",
        primary=dataset.primary,
        secondary=dataset.secondary,
        pose=pose,
        cost=float(rig.fit.cost),
        settings={"rig": rig.names},
        inputs=inputs_of(dataset, rows.frames),
        uncertainties={
            "sigma_px": {"value": noise, "source": rig.fit.source_px},
            "covariance": covariance_entry(covariance, (dataset.primary, dataset.secondary)),
            "design_effect": rig.design_effect,
        },
        frames_left_out=rig.left_out,
        noise_px=noise,
        volume=Volume.of_bars(points),
        camera_names=pair,
    )
