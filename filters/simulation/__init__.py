"""A world for tests: gusts, an autopilot's own solution, and instruments with the faults that they have."""
