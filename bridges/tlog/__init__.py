"""A recorded MAVLink log: scan, clock, one vehicle's flight."""
