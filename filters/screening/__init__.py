"""One raw channel watched alone, before any trajectory."""
