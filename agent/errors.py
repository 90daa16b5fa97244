"""The root of every error that the agent raises on purpose."""


class RadronError(Exception):
    """An error that the user can fix; the text names the fault, its place and the remedy."""


class ConfigError(RadronError):
    """A configuration, mission or scenario file that cannot be used."""


class DetectorError(RadronError):
    """Detector data or calibration that cannot be read."""


class VehicleError(RadronError):
    """The autopilot cannot be reached, or refuses."""


class FlightRecordError(RadronError):
    """A recorded flight that cannot be replayed, or a folder that cannot take one."""


class OutputError(RadronError):
    """A file that cannot, or must not, be written."""
