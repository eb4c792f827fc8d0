"""What everything agrees on: messages, frames, the station file, the bus. Imports nothing above it."""
