"""The MAVLink link to the autopilot: MAVSDK's connection, the messages read, and the sender at the other end."""
