"""What is done with a run folder, or with an instrument's record, once the flight is over."""
