"""Tables of points to match and to measure."""
