"""Where a session's results go: run folder, bus, terminal, picture."""
