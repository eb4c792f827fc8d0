"""How far the track can be trusted: protection levels, and the evidence in numbers."""
