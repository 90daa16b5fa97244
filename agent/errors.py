"""The root of every error that the agent raises on purpose."""


class RadronError(Exception):
    """Base class of the errors that the user can fix; the text names the fault, its place and the remedy."""


class ConfigError(RadronError):
    """A configuration, mission or scenario file cannot be used."""


class DetectorError(RadronError):
    """Data or calibration of the detector cannot be read."""


class VehicleError(RadronError):
    """The autopilot cannot be reached, or refuses a request."""


class FlightRecordError(RadronError):
    """A recorded flight cannot be replayed, or a folder cannot take a record."""


class OutputError(RadronError):
    """An output file cannot, or must not, be written."""
