"""The parts of method 4 (`stereocal.refine`), and what follows from its result."""
