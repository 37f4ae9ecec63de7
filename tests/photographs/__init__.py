"""Photographs drawn by `tools.photographs`, whose truth is known, small enough for tests."""
