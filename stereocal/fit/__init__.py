"""The refined method, of two cameras and more: `refine` of two, `calibrate` of all."""
