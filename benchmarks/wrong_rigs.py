"""One wrong input of a rig at a time, and sound rigs, by what `stereocal rig` does.

    python -m benchmarks.wrong_rigs [wrong|sound] [--rigs 3] [--kind "3 cameras"] [--mistake NAME]

Of each it counts: refused; named in a note; silent, with the largest error of a rotation over its
stated one (z); and what must never be: a traceback, or a file that is no JSON.
"""

import argparse
import contextlib
import io
import json
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from stereocal.cli import main as stereocal
from stereocal.fit.rig_file import RIG, ROTATION, RigFile
from stereocal.formats.dataset_files import pack_recording
from stereocal.rig.geometry import Pose
from stereocal.rig.recording import Recording
from tests.files import write
from tests.rigs.spoiled_rigs import KINDS, MISTAKES, sound

SILENT_Z = 3.0
WAVED_ONLY = ("half a frame late",)


def told(recording: Recording) -> tuple[str, str, RigFile | None]:
    """What became of a recording, as one word, what was said, and its file."""
    said, errors = io.StringIO(), io.StringIO()
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        write(pack_recording(recording), Path(folder) / "rig")
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(errors):
            try:
                status = stereocal(["rig", str(Path(folder) / "rig"), "--out", str(out)])
            except BaseException:
                return "TRACEBACK", traceback.format_exc()[-400:], None
        if status:
            files = "; FILES WRITTEN" if out.exists() else ""
            return f"refused{files}", errors.getvalue().strip().splitlines()[-1], None
        try:
            json.loads((out / RIG).read_text(), parse_constant=_refuse)
            rig = RigFile.load(out / RIG)
        except Exception as error:
            return "NO JSON", repr(error), None
    notes = [line for line in said.getvalue().splitlines() if line.startswith("Note")]
    return "noted" if notes else "silent", " ".join(notes), rig


def with_error(word: str, z: float) -> str:
    """The word of a file whose error is so many times what it states."""
    if word == "noted":
        return "noted NOT OFF" if z < SILENT_Z else word
    return "SILENT" if z > SILENT_Z else "silent, not off"


def _refuse(name: str) -> None:
    raise ValueError(name)


def largest_z(rig: RigFile, poses: Mapping[str, Pose]) -> float:
    """The largest of the rms errors of rotations over the stated ones, by camera."""
    found, first = [0.0], poses[rig.names[0]]
    for name in rig.names[1:]:
        true = poses[name] @ first.inverse()
        error = Rotation.from_matrix(rig.poses[name].R @ true.R.T).as_rotvec()
        sigma = [rig.standard_errors[name][key] for key in ROTATION]
        found.append(float(np.sqrt(np.mean(np.square(error / np.array(sigma))))))
    return max(found)


def main() -> None:
    """The parts that the command line names."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("part", nargs="?", choices=("wrong", "sound"))
    parser.add_argument("--rigs", type=int, default=2)
    parser.add_argument("--first", type=int, default=0, help="number of the first rig")
    parser.add_argument("--kind", action="append", choices=[*KINDS])
    parser.add_argument("--mistake", action="append", choices=[*MISTAKES])
    parser.add_argument("--said", action="store_true", help="print what is said")
    parsed = parser.parse_args()
    numbers = range(parsed.first, parsed.first + parsed.rigs)
    for part in [parsed.part] if parsed.part else ("wrong", "sound"):
        mistakes = (parsed.mistake or [*MISTAKES]) if part == "wrong" else ["sound"]
        for mistake in mistakes:
            began, counts, lines = time.process_time(), Counter[str](), []
            for kind in parsed.kind or KINDS:
                if mistake in WAVED_ONLY and not KINDS[kind].waved:
                    continue
                for number in numbers:
                    truth, _ = sound(kind, number)
                    wrong = MISTAKES[mistake](kind, number) if part == "wrong" else truth.recording
                    word, text, rig = told(wrong)
                    if rig is not None:
                        z = largest_z(rig, truth.poses)
                        word, text = with_error(word, z), f"z {z:.1f}; {text}"
                    counts[word] += 1
                    if parsed.said or word.isupper():
                        lines.append(f"    {kind} {number}: {word}: {text[:420]}")
            each = ", ".join(f"{word} {count}" for word, count in counts.most_common())
            print(f"{mistake}: {each} ({time.process_time() - began:.0f} s)", flush=True)
            if lines:
                print("\n".join(lines), flush=True)


if __name__ == "__main__":
    main()
