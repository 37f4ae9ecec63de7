"""Calibration boards and lenses."""
