"""Wind from airspeed, attitude and ground velocity."""
