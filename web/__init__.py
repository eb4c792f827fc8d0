"""The view in the browser: a sink like any other."""
