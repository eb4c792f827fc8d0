"""Trials on what real instruments recorded."""
