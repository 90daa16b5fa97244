"""The drones' local frames in the mission frame: estimated from the log, with the same result on every drone."""
