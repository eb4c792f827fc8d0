"""What the page keeps of a flight. No drawing here."""
