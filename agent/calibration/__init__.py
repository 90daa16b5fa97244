"""Calibration of a camera in the field, with a known source at known directions (``radron-agent calibrate``)."""
