"""The course of a random mission: times of the faults, of the network's recovery (heal), and of the end."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Course:
    """Time plan of a random mission with faults, in seconds since the start of the simulation, and limits of its size.

    Faults begin from ``first_s`` on, and all but the permanent ones end by ``heal_s``; from then on the drones must be able to
    finish. ``track_s``: range of the mission's tracking time; ``search_s``: duration of the search before the return. ``end_s``:
    a flight that has not ended is stopped. ``side_m``: range of the sides of the area, ``margin_m``: of the fence's margin;
    ``most_drones``: upper limit, at least three.
    """

    first_s: float = 5.0
    heal_s: float = 50.0
    track_s: tuple[float, float] = (60.0, 70.0)
    search_s: float = 80.0
    end_s: float = 200.0
    side_m: tuple[float, float] = (36.0, 60.0)
    margin_m: tuple[float, float] = (15.0, 30.0)
    most_drones: int = 6


FULL = Course()
SHORT = Course(
    first_s=4.0, heal_s=12.0, track_s=(9.0, 11.0), search_s=30.0, end_s=90.0, side_m=(26.0, 34.0), most_drones=3
)  # for the fast tests
DEALT = Course(
    first_s=6.0,
    heal_s=34.0,
    track_s=(26.0, 30.0),
    search_s=40.0,
    end_s=120.0,
    side_m=(26.0, 36.0),
    margin_m=(6.0, 12.0),
    most_drones=4,
)  # five faults at a time, and a fence within reach of the circles
LIVE = Course(
    first_s=10.0, heal_s=34.0, track_s=(20.0, 24.0), search_s=35.0, end_s=120.0, side_m=(26.0, 36.0), most_drones=3
)  # in real time
ATTACKED = Course(
    first_s=12.0, heal_s=44.0, track_s=(36.0, 40.0), search_s=60.0, end_s=150.0, side_m=(30.0, 40.0), most_drones=4
)  # a single attack or reset, once the source is found or nearly
