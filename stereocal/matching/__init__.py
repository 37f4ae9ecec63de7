"""Match, threshold, reconstruct, lengths, tables of points."""
