"""Flights that never were, and what instruments would say of them."""
