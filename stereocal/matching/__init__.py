"""Matching, thresholds, reconstruction, length checks and tables of points."""
