"""Photographs and data sets with known truth."""
