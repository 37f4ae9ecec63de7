"""Where the fit of all cameras begins: pairs by themselves, fused."""
