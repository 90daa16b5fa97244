"""Timeline of a flight: the changes from one state of the swarm to the next, as events for the operator."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import zip_longest

from radron.station.picture.frame import DroneFrame, Event, Frame
from radron.station.picture.orders import Heard


def told(order: Heard, at_ms: int) -> Event:
    """Return the timeline's event for an operator's order.

    An order that is only known from the drones' reports gets the time of the order, possibly long ago.
    """
    at_ms = order.first_ns // 1_000_000 if order.told else at_ms
    values = {"station": order.station, "action": order.action, "drones": ", ".join(order.numbers)}
    if not order.refused:
        return Event(at_ms=at_ms, text="order told" if order.told else "order", values=values)
    values["because"] = order.refused.replace("_", " ")
    return Event(at_ms=at_ms, text="order refused", values=values, level="warning")


class Events:
    """Finds events for the timeline, such as a found source, by comparing each state of the swarm with the state before."""

    def __init__(self, drones: list[str]) -> None:
        self._before: dict[str, DroneFrame] = {drone: DroneFrame(id=drone) for drone in drones}
        self._had_source = False
        self._finding = ""

    def since(self, frame: Frame) -> list[Event]:
        """Return the events between the last state of the swarm that was passed here and this ``frame``."""
        found = [event for drone in frame.drones for event in self._of_drone(drone, frame.at_ms)]
        if (frame.source is not None) != self._had_source:
            self._had_source = frame.source is not None
            text = "source found" if self._had_source else "source given up"
            found.append(Event(at_ms=frame.at_ms, text=text, values={}, level="info" if self._had_source else "warning"))
        if frame.finding and not self._finding:
            found.append(Event(at_ms=frame.at_ms, text="finding", values={"finding": frame.finding}))
        self._finding = frame.finding
        return found

    def _of_drone(self, drone: DroneFrame, at_ms: int) -> Iterator[Event]:
        before = self._before[drone.id]
        self._before[drone.id] = drone
        if drone.stage != before.stage and drone.stage:
            yield Event(at_ms=at_ms, text="stage", values={"drone": drone.id, "stage": drone.stage})
        if drone.stale != before.stale and (before.age_s is not None or not drone.stale):
            text = "silent" if drone.stale else "heard"
            yield Event(at_ms=at_ms, text=text, values={"drone": drone.id}, level="warning" if drone.stale else "info")
        problems, earlier = _coded(drone), _coded(before)
        for problem in (one for one in problems if one not in earlier):
            values = {"drone": drone.id, "problem": problem, "code": problems[problem]}
            yield Event(at_ms=at_ms, text="problem", values=values, level="warning")
        for problem in (one for one in earlier if one not in problems):
            values = {"drone": drone.id, "problem": problem, "code": earlier[problem]}
            yield Event(at_ms=at_ms, text="problem over", values=values)


def _coded(drone: DroneFrame) -> dict[str, str]:
    """Return the codes of a drone's problems, by text; empty where the drone sends none."""
    return dict(zip_longest(drone.problems, drone.problem_codes, fillvalue=""))
