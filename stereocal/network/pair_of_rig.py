"""A pair of a rig: its refined parameter file, and its data with the rig's lenses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stereocal.network.fuse import local_derivatives, pair_derivatives
from stereocal.network.result import RigCalibration
from stereocal.refined.parameter_file import covariance_entry
from stereocal.refined.unknowns import shared_unknowns
from stereocal.rig.compiled import FloatArray
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


def pair_covariance(rig: RigCalibration, pair: Pair) -> FloatArray:
    """(25, 25): covariance of the pair's shared unknowns, as of `bar_fit`, in the rig."""
    first, second = rig.names.index(pair[0]), rig.names.index(pair[1])
    own = Rig(rig.cameras[pair[0]], rig.cameras[pair[1]], rig.pose_of(pair))
    by_rig = pair_derivatives(first, second, rig.fit.q, rig.fit.R)
    J = local_derivatives(shared_unknowns(own)) @ by_rig
    return np.asarray(J @ rig.covariance @ J.T)


def pair_parameters(rig: RigCalibration, pair: Pair) -> RigParameters:
    """The refined file of a pair, from the rig.

    Raises:
        StereocalError: the five angles do not describe the pair.
    """
    dataset = pair_dataset(rig, pair)
    covariance, pose = pair_covariance(rig, pair), rig.pose_of(pair)
    own = Rig(dataset.primary, dataset.secondary, pose)
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
            "covariance": covariance_entry(covariance),
            "design_effect": rig.design_effect,
        },
        frames_left_out=rig.left_out,
        noise_px=noise,
        volume=Volume.of_bars(points),
        camera_names=pair,
    )
