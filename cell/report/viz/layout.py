"""Layout of a run's views in Rerun."""

from typing import Any

import rerun.blueprint as rrb

OUTLOOK = {
    "displacement": "predicted displacement, one sigma about it [mm]",
    "bending_length": "bending length [mm]",
    "retardation_time": "retardation time [ms]",
    "yield_curvature": "yarn friction [1/m]",
}


def blueprint() -> Any:
    """Layout: camera and side view on the left; states, signals and log on the right."""
    side = rrb.Spatial2DView(
        origin="/",
        contents=["/strip/**", "/gripper/**", "/desk/**"],
        name="strip [mm]: seen (orange) and simulated (blue)",
    )
    right = rrb.Vertical(
        rrb.TextDocumentView(origin="/verdict", name="verdict"),
        rrb.StateTimelineView(origin="/cell/state", name="state"),
        _plot("along", "along the strip [mm]", rrb.Corner2D.RightTop),
        _plot("above", "above the desk [mm]", rrb.Corner2D.LeftTop),
        _outlook(),
        rrb.TextLogView(origin="/log", name="log"),
        row_shares=[2, 1, 3, 3, 3, 2],
    )
    drawn = "/camera/overlay/**"
    camera = rrb.Tabs(
        rrb.Spatial2DView(origin="/camera", contents=["/camera/image", drawn], name="camera"),
        rrb.Spatial2DView(origin="/camera", contents=["/camera/film", drawn], name="film"),
        active_tab=0,
    )
    return rrb.Blueprint(
        rrb.Horizontal(rrb.Vertical(camera, side), right),
        rrb.TimePanel(timeline="t", state="collapsed"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
    )


def _outlook() -> Any:
    """Tabs of the policy's predictions: displacement with its interval, and each belief."""
    views = [
        rrb.TimeSeriesView(
            origin="/signals/outlook",
            contents=[f"/signals/outlook/{name}{end}" for end in ("", "_low", "_high")],
            name=title,
        )
        for name, title in OUTLOOK.items()
    ]
    return rrb.Tabs(*views, active_tab=0)


def _plot(group: str, name: str, corner: rrb.Corner2D) -> Any:
    legend = rrb.PlotLegend(corner=corner)
    return rrb.TimeSeriesView(origin=f"/signals/{group}", name=name, plot_legend=legend)
