"""The methods of the three papers, measured beside what the papers report."""
