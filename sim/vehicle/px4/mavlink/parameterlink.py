"""Access to an emulated vehicle's parameters over its links: read by name or index, list, set.

Errors are answered by PARAM_ERROR, as in PX4.
"""

from __future__ import annotations

from pymavlink.dialects.v20 import common as mavlink

from radron.sim.vehicle.px4.mavlink.link import Link
from radron.sim.vehicle.px4.parameters import Parameters
from radron.sim.vehicle.px4.state import Message

UNKNOWN: int = mavlink.MAV_PARAM_ERROR_DOES_NOT_EXIST
WRONG_TYPE = 7  # PX4's own number; pymavlink does not name it
HASH = "_HASH_CHECK"  # in place of a name
_NO_INDEX = 65_535
_MAX_NAME_LENGTH = 16


class ParameterLink:
    """Answers the parameter messages of one vehicle's links.

    Values out of a parameter's range are accepted silently, as in PX4.
    """

    def __init__(self, parameters: Parameters) -> None:
        self._parameters = parameters

    def read(self, link: Link, message: Message) -> None:
        """Answer PARAM_REQUEST_READ with the value of a parameter."""
        names, index = self._parameters.names, message.param_index
        name = message.param_id if index < 0 else "".join(names[index : index + 1])
        if name == HASH:
            self._send_hash(link)
        elif name in self._parameters:
            self._send(link, name)
        else:
            self._refuse(link, message, name, UNKNOWN)

    def list(self, link: Link, message: Message) -> None:
        """Answer PARAM_REQUEST_LIST with all parameters.

        The hash comes first, for a ground station that knows the parameters already.
        """
        self._send_hash(link)
        for name in self._parameters.names:
            self._send(link, name)

    def set(self, link: Link, message: Message) -> None:
        """Answer PARAM_SET: change a parameter."""
        name = message.param_id
        if name == HASH:  # of a ground station that needs no more of the list, which has been sent already
            return
        if name not in self._parameters:
            self._refuse(link, message, name, UNKNOWN)
        elif message.param_type != self._parameters.kind(name):
            self._refuse(link, message, name, WRONG_TYPE)
        else:
            self._parameters.set(name, message.param_value)
            self._send(link, name)

    def _send(self, link: Link, name: str) -> None:
        parameters = self._parameters
        index, count = parameters.names.index(name), len(parameters.names)
        link.send(mavlink.MAVLink_param_value_message(name.encode(), parameters.wire(name), parameters.kind(name), count, index))

    def _send_hash(self, link: Link) -> None:
        parameters = self._parameters
        value, count = parameters.hash_wire, len(parameters.names)
        link.send(mavlink.MAVLink_param_value_message(HASH.encode(), value, mavlink.MAV_PARAM_TYPE_UINT32, count, _NO_INDEX))

    def _refuse(self, link: Link, message: Message, name: str, error: int) -> None:
        sender = (message.get_srcSystem(), message.get_srcComponent())
        content = name.encode()[:_MAX_NAME_LENGTH]
        link.send(mavlink.MAVLink_param_error_message(*sender, content, getattr(message, "param_index", -1), error))
