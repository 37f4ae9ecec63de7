"""Rigs, scenes and photographs with known truth."""
