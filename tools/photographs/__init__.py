"""Renders photographs of the bar and of boards with known truth, for the samples and the tests."""
