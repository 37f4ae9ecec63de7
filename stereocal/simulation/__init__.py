"""Synthetic rigs, scenes and photographs with known ground truth."""
