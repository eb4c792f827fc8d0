"""What the report's tables and figures are made of: the run as it is read, its statistics, the page."""
