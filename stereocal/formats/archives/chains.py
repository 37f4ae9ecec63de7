"""Camera files with any number of cameras: Kalibr's camchain, aniposelib and Caliscope."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from stereocal.errors import StereocalError
from stereocal.formats.archives.archive import (
    CameraPair,
    chosen_pair,
    chosen_words,
    remarks_on_choice,
)
from stereocal.formats.exchange.aniposelib import toml_camera, toml_pose
from stereocal.formats.exchange.kalibr import kalibr_camera
from stereocal.formats.exchange.options import ExchangeOptions, array_of
from stereocal.rig.geometry import Pose


def kalibr_names(data: Mapping[str, Any]) -> tuple[str, ...]:
    """Names of the cameras of a camchain, in its order; empty for another YAML file."""
    found = [key for key in data if key.startswith("cam") and key[3:].isdecimal()]
    return tuple(sorted(found, key=lambda key: int(key[3:])))


def read_chain(
    data: Mapping[str, Any], wanted: tuple[str, str] | None, options: ExchangeOptions, name: str
) -> CameraPair:
    """Two cameras of Kalibr's camchain; the pose is known if the chain between them is whole.

    Raises:
        StereocalError: the cameras are not there, or as `kalibr_camera`.
    """
    names = kalibr_names(data)
    pair = chosen_pair(names, wanted, name)
    primary, secondary = (
        kalibr_camera(data[names[at]], k, options, f"{name}, {names[at]}")
        for k, at in enumerate(pair)
    )
    pose = Pose(np.eye(3), np.zeros(3))
    for key in names[min(pair) + 1 : max(pair) + 1]:
        if not isinstance(data[key], dict) or data[key].get("T_cn_cnm1") is None:
            return CameraPair("Kalibr", primary, secondary, None, chosen_words(names, pair))
        T = array_of(data[key]["T_cn_cnm1"], (4, 4), "T_cn_cnm1", f"{name}, {key}")
        pose = Pose(T[:3, :3], T[:3, 3]) @ pose
    pose = pose if pair[0] < pair[1] else pose.inverse()
    remarks = remarks_on_choice(names, wanted)
    return CameraPair(
        "Kalibr", primary, secondary, pose, chosen_words(names, pair), usual="m", remarks=remarks
    )


def toml_sections(data: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """The cameras of aniposelib's `[cam_0]`, or of Caliscope's `[cameras.0]`, in their order.

    Cameras that Caliscope ignores are left out.
    """
    caliscope = data.get("cameras")
    found = caliscope if isinstance(caliscope, dict) else data
    return {
        key: found[key]
        for key in sorted(found, key=lambda key: (len(key), key))
        if isinstance(found[key], dict) and "matrix" in found[key] and not found[key].get("ignore")
    }


def read_sections(
    data: Mapping[str, Any], wanted: tuple[str, str] | None, options: ExchangeOptions, name: str
) -> CameraPair:
    """Two cameras of aniposelib's or Caliscope's file; the pose is known if both have one.

    Raises:
        StereocalError: the cameras are not there, or as `toml_camera`.
    """
    sections = toml_sections(data)
    if not sections:
        raise StereocalError(
            f"{name}: this TOML file has no cameras, as aniposelib's calibration.toml or "
            "Caliscope's camera_array.toml."
        )
    names = tuple(sections)
    pair = chosen_pair(names, wanted, name)
    chosen = [sections[names[at]] for at in pair]
    sources = [f"{name}, {names[at]}" for at in pair]
    primary, secondary = (
        toml_camera(each, k, options, source)
        for k, (each, source) in enumerate(zip(chosen, sources, strict=True))
    )
    pose = None
    if all("rotation" in each and "translation" in each for each in chosen):
        first, second = (
            toml_pose(each, source) for each, source in zip(chosen, sources, strict=True)
        )
        pose = second @ first.inverse()
    program = "Caliscope" if "cameras" in data or "charuco" in data else "aniposelib"
    return CameraPair(
        program,
        primary,
        secondary,
        pose,
        chosen_words(names, pair),
        remarks=remarks_on_choice(names, wanted),
    )
