"""What the names of `import stereocal` answer for a rig of several cameras, with all digits. Run by
a case."""

import sys

import numpy as np
import pandas as pd

import stereocal

np.set_printoptions(floatmode="unique", threshold=sys.maxsize, linewidth=100)
recording = stereocal.read(sys.argv[1])
assert isinstance(recording, stereocal.Recording)
found = stereocal.calibrate_rig(recording)
print(found)
for name, pose in found.poses.items():
    print(name, pose.R, pose.T, sep="\n")
print(found.to_dataframe().to_csv())
points = {
    name: pd.DataFrame(
        {
            "frame": recording.frame[recording.camera == number],
            "u": recording.points[recording.camera == number, 0],
            "v": recording.points[recording.camera == number, 1],
        }
    )
    for number, name in enumerate(recording.cameras)
}
tracks = stereocal.match(found, points)
tracks.to_csv("tracks.csv", index=False)
stereocal.reconstruct(found, tracks).to_csv("points.csv", index=False)
pair = stereocal.calibrate(recording.pair(*[*recording.cameras][:2]))
print(pair.recommendation)
