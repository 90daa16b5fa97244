"""Section ``[survey]`` of a mission file: the flight in search of a source, or for a map of contaminated ground."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from radron.agent.config.section import Activity, Positive, Section
from radron.agent.errors import ConfigError


class SurveyConfig(Section, frozen=True, kw_only=True):
    """The flight in search of a source, before there is a first source estimate (the hypothesis).

    ``strategy``: ``information`` flies to the waypoints of largest expected information gain, at ``search_speed_mps``; ``lanes``
    covers the area in parallel lanes, at ``speed_mps`` (paper, Sec. V-A). Lanes are also flown with an estimator that gives no
    search posterior (a probability map of the source over the area), with the flocking law ``paper``, and in areas whose bounding
    rectangle is larger than 9 ha.

    ``map`` flies lanes for a map of contaminated ground, and tracks no source; afterwards, with ``low_height_m``, lower and
    closer lanes over the blocks above half of the highest one. It ends after ``duration_s``, or once the relative uncertainty of
    these blocks (half of the 90 % interval, their median) is ``block_uncertainty`` or less, which needs ``duration_s``, too;
    without both, after the last lane.

    The search ends without a result once every source of ``least_activity_bq`` or more is excluded (none: never), or after
    ``duration_s`` (none: no limit). ``then`` the swarm returns, or continues to search. With an estimator of several sources the
    search continues after the first source, until all of the area is covered. It resumes once each source has been circled, until
    any further source of ``least_activity_bq`` is excluded, or ``duration_s`` is over.
    """

    later: ClassVar[frozenset[str]] = frozenset({"low_height_m", "block_uncertainty"})

    height_m: Positive = 3.0
    speed_mps: Positive = 3.0
    lane_spacing_m: Annotated[float, Meta(ge=0.5, le=1000.0)] = 10.0
    yaw_rate_rps: Annotated[float, Meta(ge=-6.3, le=6.3)] = 0.5
    strategy: Literal["information", "lanes", "map"] = "information"
    search_speed_mps: Positive = 6.5
    least_activity_bq: Activity | None = 5e7
    duration_s: Positive | None = None
    then: Literal["return", "continue"] = "return"
    low_height_m: Positive | None = None
    block_uncertainty: Annotated[float, Meta(gt=0.0, le=1.0)] | None = None

    def check(self, where: str) -> None:
        """Raise ConfigError if the lanes of a map are too far apart, or its keys do not fit together."""
        if self.strategy != "map":
            if self.low_height_m is not None or self.block_uncertainty is not None:
                raise ConfigError(f"{where}: survey.low_height_m and survey.block_uncertainty need survey.strategy = 'map'")
            return
        if self.lane_spacing_m > 2.0 * self.height_m:
            raise ConfigError(
                f"{where}: survey.lane_spacing_m = {self.lane_spacing_m:g} leaves gaps in a map; give at most twice "
                f"survey.height_m, {2.0 * self.height_m:g}"
            )
        if self.low_height_m is not None and self.low_height_m >= self.height_m:
            raise ConfigError(f"{where}: survey.low_height_m = {self.low_height_m:g} is not below survey.height_m")
        if self.block_uncertainty is not None and self.duration_s is None:
            raise ConfigError(
                f"{where}: survey.block_uncertainty needs survey.duration_s, too: over clean ground there are no blocks to know"
            )
