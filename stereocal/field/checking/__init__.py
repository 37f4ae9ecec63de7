"""After the field day: has a camera moved, and the repaired parameters."""
