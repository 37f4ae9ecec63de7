"""Three and more cameras: pairs fused, one joint adjustment, what it says of each camera."""
