"""What a session is fed from: the bus, logs and feeds, a recording; and whose clock counts there."""
