"""The MAVLink link to the autopilot: MAVSDK's connection, the messages read, and who is at the other end."""
