"""The wind paper: simulated winds and a recorded flight."""
