"""How messages travel: the bus, what waits of each source, who may write a key, certificates."""
