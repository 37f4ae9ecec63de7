"""Finding X-corners in one photograph, to a hundredth of a pixel."""
