"""Conventions: geometry, cameras, two cameras and their pose, data sets, what numba needs."""
