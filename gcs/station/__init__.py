"""The session that turns measurements into verdicts and states, and its two sources: live and replay."""
