"""From detections, satellite fixes and relative observations to log entries."""
