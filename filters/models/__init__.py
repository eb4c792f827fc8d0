"""What is assumed about motion and about each kind of sensor, and the rows that all filters share."""
