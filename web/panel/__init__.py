"""The panel beside the picture: text and handles."""
