"""Targets in one photograph: candidates, edges, corner model, fit."""
