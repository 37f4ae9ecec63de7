"""The photographs of all frames: pairs, targets, their labels, and manual review."""
