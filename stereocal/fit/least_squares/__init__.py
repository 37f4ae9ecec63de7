"""Least squares over pixels, lengths and priors of N cameras: unknowns, residuals, robust fit."""
