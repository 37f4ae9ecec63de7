"""Cameras that are late, and cameras started by hand: brought into step."""
