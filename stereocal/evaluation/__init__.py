"""Validation (paper, Section 6): random splits, error counts, intervals, summary."""
