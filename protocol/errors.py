"""The one error of this package."""


class ProtocolError(ValueError):
    """A payload or key that this version of the protocol does not accept; the text names the fault and its place."""


class MeshError(ProtocolError):
    """The Zenoh session cannot be opened as configured."""
