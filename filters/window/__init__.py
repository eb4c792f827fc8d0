"""The estimator: rows judged in a window of some seconds, before a decision is final."""
