"""The GA-BP-UKF paper: its simulations, its filter, the default network."""
