"""Detect the two targets in one photograph: candidates, edges, corner model, fit, checks."""
