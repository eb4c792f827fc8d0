"""MAVLink live, and what an autopilot's messages and clock mean, live or recorded."""
