"""Flights to learn from, the training of the correction network, and its file."""
