"""Filters of the literature, to compare with."""
