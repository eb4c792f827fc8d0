"""The plots: curves out of what the page keeps, and their place on the page."""
