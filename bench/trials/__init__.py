"""Trials of an estimator: recorded and simulated flights, simulated instruments, scores against the truth."""
