"""Boards in photographs, and what is said and kept of a lens."""
