"""Map of a flight: area, tracks, cones, estimate and truth."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon
from numpy.typing import NDArray

from radron.protocol.messages import Source
from radron.protocol.stages import CIRCLING
from radron.sim.figures.cones import ground_curve
from radron.sim.figures.ellipse import draw_regions, reach_m
from radron.sim.figures.faultmarks import fault_entries, fault_places
from radron.sim.figures.style import CONE, ESTIMATE, TRUTH, dress, drone_colour, new_figure, wrapped
from radron.sim.result import Trace

CONES_SHOWN = 20  # more would cover the map
_INSET_BELOW = 0.04  # share of the map's width: a smaller 90 % region is also shown enlarged
_INSET_SIZE = 0.32  # share of the map's width
_OPEN = "#8a8a8a"


def map_figure(trace: Trace, title: tuple[str, ...]) -> Figure:
    """Draw a flight from above, at the end of the tracking.

    Shown are the tracks, the newest cones, and the source estimate. The ellipses are the regions that contain each source with
    probabilities of 50 % and 90 %. ``title``: the parts of the title.
    """
    figure = new_figure(8.0, 8.0)
    axes = figure.add_subplot()
    end = last_tracking(trace)
    left, right, bottom, top = _window(trace)
    _draw_cones(axes, trace, end, reach_m=float(np.hypot(right - left, top - bottom)))
    axes.add_patch(Polygon(trace.area_m, closed=True, fill=False, edgecolor="#444444", linewidth=1.2, linestyle=(0, (6, 3))))
    tracking = np.isin(trace.swarm_stage, CIRCLING)
    for drone, name in enumerate(trace.drones):
        track = trace.position_m[:, drone]
        colour = drone_colour(drone)
        axes.plot(track[:, 0], track[:, 1], color=colour, linewidth=1.0, alpha=0.35)
        circling = np.where(tracking[:, None], track[:, :2], np.nan)
        axes.plot(circling[:, 0], circling[:, 1], color=colour, linewidth=1.3, alpha=0.8)
        axes.plot(*track[0, :2], marker="^", color=colour, markersize=8, markeredgecolor="white", linestyle="")
        axes.plot(*track[end, :2], marker="o", color=colour, markersize=8, markeredgecolor="white", label=name, linestyle="")
    _draw_open(axes, trace)
    _draw_source(axes, trace, end)
    fault_places(axes, trace)
    axes.set_aspect("equal")
    axes.set_xlim(left, right)
    axes.set_ylim(bottom, top)
    _draw_inset(axes, trace, end)
    dress(axes, wrapped(title, 76), "east of the mission's origin (m)", "north of the mission's origin (m)")
    _legend(axes, trace)
    return figure


def _draw_open(axes: Axes, trace: Trace) -> None:
    """Where further sources are not excluded."""
    for places, marker, text in _open(trace):
        axes.plot(*places.T, marker=marker, color=_OPEN, markersize=3.5, linestyle="", alpha=0.7, label=text)


def _open(trace: Trace) -> list[tuple[NDArray[np.float64], str, str]]:
    """Places, marker and name of each kind that there is."""
    kinds = (trace.left_m, "s", "more may hide"), (trace.glare_m, "+", "not excluded: outshone")
    return [kind for kind in kinds if len(kind[0])]


def last_tracking(trace: Trace) -> int:
    """Return the index of the sample that shows the final source estimate of a flight.

    It is the last sample at which the first drone tracked with an estimate, else the last sample with an estimate, else the very
    last.
    """
    has = np.isfinite(trace.estimate_m[:, 0])
    tracking = has & np.isin(trace.swarm_stage, CIRCLING)
    for choice in (tracking, has):
        if choice.any():
            return int(np.flatnonzero(choice)[-1])
    return len(trace.time_s) - 1


def _window(trace: Trace) -> tuple[float, float, float, float]:
    """Limits of the map: a square around the area and all tracks, with a margin."""
    points: NDArray[np.float64] = np.vstack([trace.area_m, trace.position_m[:, :, :2].reshape(-1, 2)])
    low, high = points.min(axis=0), points.max(axis=0)
    centre, half = (low + high) / 2.0, float(np.max(high - low)) / 2.0 * 1.06
    return centre[0] - half, centre[0] + half, centre[1] - half, centre[1] + half


def _draw_source(axes: Axes, trace: Trace, end: int) -> None:
    _draw_truth(axes, trace, end)
    _draw_estimate(axes, trace, end)


def _draw_inset(axes: Axes, trace: Trace, end: int) -> None:
    """The estimate's regions and the true source enlarged, if they are too small on the map."""
    estimate, covariance = trace.estimate_m[end, :2], trace.covariance_m2[end]
    if not np.isfinite(estimate).all() or not np.isfinite(covariance).all():
        return
    truth = trace.source_m[end, :2]
    error_m = float(np.hypot(*(truth - estimate))) if np.isfinite(truth).all() else 0.0
    half_m = 1.6 * max(reach_m(covariance), error_m, 0.05)
    left, right = axes.get_xlim()
    if 2.0 * half_m > _INSET_BELOW * (right - left):
        return
    inset = axes.inset_axes((*_free_corner(axes, trace), _INSET_SIZE, _INSET_SIZE))
    _draw_source(inset, trace, end)
    x, y = estimate.tolist()
    inset.set_xlim(x - half_m, x + half_m)
    inset.set_ylim(y - half_m, y + half_m)
    inset.set_aspect("equal")
    inset.set_xticks([])
    inset.set_yticks([])
    inset.set_title(f"enlarged: {2.0 * half_m:.2g} m wide", fontsize=8, pad=2.0)
    axes.indicate_inset_zoom(inset, edgecolor="#444444")


def _free_corner(axes: Axes, trace: Trace) -> tuple[float, float]:
    """Lower left corner of an inset, in axes coordinates (0 to 1), that hides the fewest sources, and points of the tracks."""
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    sources = np.array([truth.place_m[:2] for truth in trace.truths]).reshape(-1, 2)
    shown = sources, trace.position_m[:, :, :2].reshape(-1, 2)
    sources, tracks = ((points - (left, bottom)) / (right - left, top - bottom) for points in shown)
    far = 0.98 - _INSET_SIZE
    corners = [(x, y) for y in (far - 0.02, 0.02) for x in (far, 0.02)]  # at the top there must be room for its title

    def hidden(corner: tuple[float, float], points: NDArray[np.float64]) -> int:
        inside = (points >= corner) & (points <= (corner[0] + _INSET_SIZE, corner[1] + _INSET_SIZE))
        return int(np.count_nonzero(inside.all(axis=1)))

    return min(corners, key=lambda corner: (hidden(corner, sources), hidden(corner, tracks)))


def _draw_cones(axes: Axes, trace: Trace, end: int, reach_m: float) -> None:
    """The newest cones, each in its more probable order."""
    seen = [cone for cone in trace.cones if cone.time_s <= trace.time_s[end]]
    for cone in seen[-CONES_SHOWN:]:
        curve = ground_curve(cone.apex_m, cone.axis[0], float(cone.theta_rad[0]), reach_m)
        axes.plot(curve[:, 0], curve[:, 1], color=CONE, linewidth=0.7, alpha=0.45)


def _draw_truth(axes: Axes, trace: Trace, end: int) -> None:
    if len(trace.truths) > 1:
        for source in trace.truths:
            axes.plot(*source.place_m[:2], marker="*", color=TRUTH, markersize=15, markeredgecolor="white", zorder=6)
        return
    path = trace.source_m[: end + 1]
    if not np.isfinite(path[end]).all():
        return
    if np.ptp(path[:, :2], axis=0).max() > 1.0:
        axes.plot(path[:, 0], path[:, 1], color=TRUTH, linewidth=1.2, linestyle=(0, (1, 1.5)))
    axes.plot(*path[end, :2], marker="*", color=TRUTH, markersize=15, markeredgecolor="white", zorder=6)


def _draw_estimate(axes: Axes, trace: Trace, end: int) -> None:
    estimate = trace.estimate_m[: end + 1]
    if not np.isfinite(estimate[end]).all():
        return
    axes.plot(estimate[:, 0], estimate[:, 1], color=ESTIMATE, linewidth=0.9, alpha=0.5, zorder=4)
    centre = (float(estimate[end, 0]), float(estimate[end, 1]))
    if np.isfinite(trace.covariance_m2[end]).all():
        draw_regions(axes, centre, trace.covariance_m2[end])
    axes.plot(*centre, marker="X", color=ESTIMATE, markersize=11, markeredgecolor="white", zorder=7)
    for source in _others(trace, end):
        xx, xy, _, yy, _, _ = source.covariance_m2
        x, y, _ = source.position_m
        draw_regions(axes, (x, y), np.array([[xx, xy], [xy, yy]]))
        axes.plot(x, y, marker="X", color=ESTIMATE, markersize=9, markeredgecolor="white", zorder=7)


def _others(trace: Trace, end: int) -> tuple[Source, ...]:
    """The further sources of the estimate that was published last before sample ``end``."""
    published = [estimate for estimate in trace.estimates if estimate.time_s <= trace.time_s[end]]
    return published[-1].sources[1:] if published else ()


def _legend(axes: Axes, trace: Trace) -> None:
    entries = [
        Line2D(
            [],
            [],
            color=drone_colour(k),
            marker="o",
            markeredgecolor="white",
            label=f"{name} (start: triangle)" if k == 0 else name,
        )
        for k, name in enumerate(trace.drones)
    ]
    if np.isfinite(trace.estimate_m[:, 0]).any():
        entries.append(Line2D([], [], color=ESTIMATE, marker="X", markeredgecolor="white", label="estimate, 50 and 90 %"))
    truth = "true sources" if len(trace.truths) > 1 else "true source"
    if np.isfinite(trace.source_m).any():
        entries.append(
            Line2D(
                [],
                [],
                color=TRUTH,
                marker="*",
                markersize=11,
                linestyle=(0, (1, 1.5)),
                label=truth,
            )
        )
    if trace.cones:
        entries.append(Line2D([], [], color=CONE, linewidth=0.8, label=f"newest {CONES_SHOWN} cones on the ground"))
    entries.append(Line2D([], [], color="#444444", linestyle=(0, (6, 3)), label="searched area"))
    entries += [
        Line2D([], [], color=_OPEN, marker=marker, markersize=4, linestyle="", label=text) for _, marker, text in _open(trace)
    ]
    entries += fault_entries(trace)
    axes.legend(handles=entries, loc="upper center", bbox_to_anchor=(0.5, -0.08), ncols=4, fontsize=8, frameon=False)
