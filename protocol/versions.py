"""Versions of the formats that releases exchange or keep.

Messages: a drone reads those of its own version. Flight records: their version is that of their messages, and only the present
one is read. State: older versions are read, newer ones refused. Readouts of a detector feed: both ends have the same version.
"""

PROTOCOL = 2  # 1 was never released
STATE = 1  # kept over a restart; raised when an older release would misread it
READOUT = 1
READOUT_WITH_COUNTS = 2  # the same, of an ordinary detector: its counts follow
