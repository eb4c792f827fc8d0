"""The learned part: a small network, and how it is trained."""
