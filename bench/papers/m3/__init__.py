"""The screening paper: one channel alone, and together with the trajectory filter."""
