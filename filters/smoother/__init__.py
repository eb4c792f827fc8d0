"""The estimator: see `filters.smoother.estimator`."""
