"""What the names of `import stereocal` answer for a data set, with all digits. Run by a case."""

import sys

import numpy as np
import pandas as pd

import stereocal

np.set_printoptions(floatmode="unique", threshold=sys.maxsize, linewidth=100)
dataset = stereocal.read_dataset(sys.argv[1])
rows = dataset.correspondences
for camera, pixels in ((dataset.primary, rows.primary), (dataset.secondary, rows.secondary)):
    rays = camera.undistort(pixels)
    print(rays, camera.distort(rays) - pixels, camera.undistort_to_pixels(pixels), sep="\n")

settings = stereocal.CalibrationSettings()
calibration = stereocal.calibrate(dataset, settings)
for method, result in calibration.methods.items():
    print(method, result.pose.R, result.pose.T, sep="\n")
found = {
    "2d": calibration.parameters("2d"),
    "3d": calibration.parameters("3d"),
    "refined": calibration.parameters("refined"),
}
primary, secondary = (
    pd.DataFrame({"frame": rows.frame, "u": of[:, 0], "v": of[:, 1], "target": rows.target})
    for of in (rows.primary, rows.secondary)
)
for name, parameters in found.items():
    parameters.save(f"{name}.json")
    pairs = stereocal.match(parameters, primary, secondary, threshold_px="auto")
    pairs.to_csv(f"pairs_{name}.csv", index=False)
    points = stereocal.reconstruct(parameters, pairs, sigma_px=0.15)
    points.to_csv(f"points_{name}.csv", index=False)

try:
    stereocal.export(found["3d"], "opencv", "opencv_files")
    stereocal.import_parameters("opencv_files", "opencv").save("imported.json")
except stereocal.StereocalError as error:
    print(error)
