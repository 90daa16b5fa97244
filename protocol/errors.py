"""The errors that this package raises."""


class ProtocolError(ValueError):
    """A message or key is not acceptable in this version of the protocol; the text names the fault and its place."""


class MeshError(ProtocolError):
    """The network session (Zenoh) between the drones cannot be opened with the configured addresses."""
