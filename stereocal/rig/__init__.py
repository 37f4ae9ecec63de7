"""Geometry and conventions, cameras, the rig, data sets, compilation with numba."""
