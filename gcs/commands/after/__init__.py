"""What is done with a run folder once the run is over."""
