"""How things look: colours, and pieces of the panel's text."""
