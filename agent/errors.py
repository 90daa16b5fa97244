"""The root of every error that the agent raises on purpose."""


class RadronError(Exception):
    """Something that the user can mend; the text says what is wrong, where, and what to do."""


class ConfigError(RadronError):
    """A configuration, mission or scenario file that cannot be used."""


class DetectorError(RadronError):
    """Detector data or calibration that cannot be read."""


class VehicleError(RadronError):
    """The autopilot cannot be reached, or refuses."""


class FlightRecordError(RadronError):
    """A recorded flight that cannot be replayed, or a folder that cannot take one."""
