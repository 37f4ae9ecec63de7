"""What a script and a notebook call: one function an act, whose result says its answer."""
