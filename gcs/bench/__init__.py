"""Measurements of the station against what the papers report."""
