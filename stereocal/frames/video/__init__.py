"""Frames of two videos as photographs."""
