"""How fast: the filter beside others, a log, a replay, the live station."""
