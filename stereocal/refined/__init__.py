"""The parts of method 4 (`stereocal.refined.refine`), and what follows from its result."""
