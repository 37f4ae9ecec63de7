"""Stereo camera calibration from a bar: one parameter set to match points, one to measure."""

__version__ = "0.1.0"
