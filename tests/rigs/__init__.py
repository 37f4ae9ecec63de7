"""Simulated rigs, recordings and mistakes with known truth, for the tests and the benchmarks."""
