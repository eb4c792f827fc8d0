"""The 3-D picture."""
