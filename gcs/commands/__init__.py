"""The command ``gcs``, one file a command; ``compose`` is the one place that puts a run together."""
