"""Layout of a run's views in Rerun."""

from typing import Any

import rerun.blueprint as rrb

OUTLOOK = {
    "displacement": "predicted displacement, one sigma about it [m]",
    "bending_length": "bending length [m]",
    "retardation_time": "retardation time [s]",
    "yield_curvature": "yarn friction [1/m]",
}


def blueprint() -> Any:
    """Layout: camera and side view on the left; states, signals and log on the right."""
    eye = rrb.EyeControls3D(position=(0.3, -0.75, 0.2), look_target=(0.3, 0.0, 0.14))
    side = rrb.Spatial3DView(
        origin="/",
        contents=["/strip/**", "/gripper/**", "/desk/**"],
        name="strip: seen (orange) and simulated (blue)",
        eye_controls=eye,
    )
    right = rrb.Vertical(
        rrb.StateTimelineView(origin="/cell/state", name="state"),
        _plot("along", "along the strip [m]", rrb.Corner2D.RightTop),
        _plot("above", "above the desk [m]", rrb.Corner2D.LeftTop),
        _outlook(),
        rrb.TextLogView(origin="/log", name="log"),
        row_shares=[1, 3, 3, 3, 2],
    )
    camera = rrb.Spatial2DView(origin="/camera", name="camera")
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
