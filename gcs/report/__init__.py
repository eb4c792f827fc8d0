"""After a run: its folder as one page that an engineer signs, and two runs held against each other."""
