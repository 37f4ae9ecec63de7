"""Pairs of cameras in the files of `described`."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

from stereocal.errors import StereocalError
from stereocal.formats.camera_file import camera_of
from stereocal.formats.described import PROGRAMS, Cameras, Program, only_of
from stereocal.formats.exchange.camera_format import (
    ONE_LENS,
    CameraFormat,
    Files,
    ForeignPair,
    known_pose,
    named_as_both,
    pose_from,
    stated_unit,
)
from stereocal.formats.exchange.chosen_cameras import chosen_pair
from stereocal.formats.exchange.options import ExchangeOptions
from stereocal.formats.file_storage import ForeignFile, Storage, find_node
from stereocal.formats.lens_nodes import R_NAMES, T_NAMES
from stereocal.rig.geometry import AT_ORIGIN, Pose


def _read(program: Program, files: Files, options: ExchangeOptions, source: str) -> ForeignPair:
    """Two cameras of one file or of two, or one lens for both."""
    files = [file for file in files if program.knows(file)] or files
    single = program.one_camera or len(files) > 1
    if len(files) > 1 + single or not files:
        raise StereocalError(f"{len(files)} files of {program.title}; give one or two.", source)
    chosen, notes = None, tuple[str, ...]()
    if single:
        named: Cameras = {file.name: only_of(program.cameras_of(file), file.name) for file in files}
        names, notes = named_as_both([*named], options, source)
        sources = names
    else:
        (file,) = files
        named = program.cameras_of(file)
        chosen = chosen_pair([*named], options.cameras, file.name) if len(named) > 1 else None
        names = chosen.names if chosen else (next(iter(named)),) * 2
        sources = f"{file.name}, {names[0]}", f"{file.name}, {names[1]}"
    first, second = (
        camera_of(named[name], where, options.lens_model, size)
        for name, where, size in zip(names, sources, options.image_sizes, strict=True)
    )
    has_pose = program.pose is not None and names[0] != names[1]
    lacks = f"{source}: {program.no_pose or 'one camera has no pose'}."
    pose, no_pose, bad = known_pose(
        lambda: _pose(program, files[0], named, names) if has_pose else None, lacks
    )
    remarks = {str(named[name]["remark"]) for name in names if "remark" in named[name]}
    notes += (*remarks, *bad)
    pair = ForeignPair(first, second, pose, no_pose, program.title, chosen, notes=notes)
    unit = stated_unit(files[0].storage) if program.of_pair is not None else None
    called = "" if chosen or len(files) > 1 else ONE_LENS
    return replace(pair, stated=unit, called=called, files=names if len(files) > 1 else None)


def _pose(program: Program, file: ForeignFile, named: Cameras, names: tuple[str, str]) -> Pose:
    """The second camera from the first."""
    source = f"{file.name} ({program.title})"
    if program.of_pair is not None:
        if len(named) > 2:
            raise StereocalError("it is not said of which two cameras its R and T are.", source)
        pose = _of_nodes(program.of_pair(file), source)
        pose = pose.inverse() if program.pose == "primary_from_secondary" else pose
        return pose if [*names] == [*named] else pose.inverse()
    (first, root), (second, other_root) = (
        _from_root(program, named, name, source) for name in names
    )
    if root != other_root:
        raise StereocalError("no pose leads from one of the cameras to the other.", source)
    return second @ first.inverse()


def _from_root(program: Program, named: Cameras, name: str, source: str) -> tuple[Pose, str]:
    """A camera from the world, or from the camera to which the poses of a chain lead; its name."""
    pose, passed = AT_ORIGIN, {name}
    while "M" in named[name] or find_node(named[name], R_NAMES) is not None:
        following = str(named[name].get("to", ""))
        if "to" in named[name] and following not in named:
            return pose, name
        step = _of_nodes(named[name], f"{source}, {name}")
        pose = pose @ (step if program.pose == "camera_from_world" else step.inverse())
        if not following:
            return pose, ""
        if following in passed:
            raise StereocalError("the poses of its cameras lead in a circle.", source)
        passed.add(following)
        name = following
    raise StereocalError(f"{name} has no pose.", source)


def _of_nodes(node: Storage, source: str) -> Pose:
    if "M" in node:
        return pose_from(node["M"], None, source)
    return pose_from(find_node(node, R_NAMES), find_node(node, T_NAMES), source)


def _names(program: Program, file: ForeignFile) -> tuple[str, ...]:
    return tuple(program.cameras_of(file))


DESCRIBED: Mapping[str, CameraFormat] = {
    name: CameraFormat(
        program.title,
        partial(_read, program),
        program.knows,
        None if program.one_camera else partial(_names, program),
        one_camera=program.one_camera,
        unit=program.unit,
    )
    for name, program in PROGRAMS.items()
}
