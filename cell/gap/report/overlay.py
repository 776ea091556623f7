"""Rerun recording `overlay.rrd`: runs as measured, and as simulated before and after.

Of run NAME: /NAME/curve, /NAME/tracks and /NAME/signals, each with `measured`, `before`
(the refitted base) and `after` (the accepted model), on the run's own time `t`, and
/NAME/events. The sentence of the verdict is in /verdict.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from cell.gap.report.figures import COLOUR_AFTER, COLOUR_BEFORE, Replay, replay
from cell.gap.report.sentence import headline, sentence
from cell.gap.subject.subject import Scene
from cell.gap.verdict.findings import Findings
from cell.gap.verdict.schema import Verdict
from cell.report.viz.saving import saving, send_blueprint
from drivers.base.errors import ConfigurationError
from drivers.base.files import replacing
from drivers.base.types import Array

CURVE_COLOURS = {
    "measured": 0xFFAA32FF,
    "before": int(COLOUR_BEFORE[1:] + "ff", 16),
    "after": int(COLOUR_AFTER[1:] + "ff", 16),
}
HAND_RGBA, DESK_RGBA = 0xC9CED6FF, 0x8A9099FF
RADIUS_MM = 1.2  # mm


def write_overlay(findings: Findings, verdict: Verdict, path: Path) -> None:
    """Write the Rerun recording of a fit's runs at `path`; ConfigurationError on
    failure.
    """
    words = f"{headline(verdict)}. {sentence(findings, verdict)}"
    write_recording(findings.subject.name, list(replay(findings)), path, words)


def write_recording(name: str, runs: Sequence[Replay], path: Path, words: str) -> None:
    """Write a Rerun recording of `runs` of the subject `name`; ConfigurationError on
    failure.
    """
    recording = rr.RecordingStream("cell gap", recording_id=f"gap-{name}")
    try:
        with replacing(path) as scratch, saving(recording, scratch):
            send_blueprint(recording, blueprint(runs))
            recording.log("verdict", rr.TextDocument(words), static=True)
            for run in runs:
                _log_run(recording, run)
    except (OSError, RuntimeError, ValueError) as error:
        raise ConfigurationError(f"{path}: cannot be written: {error}") from None


def blueprint(runs: Sequence[Replay]) -> Any:
    """Rerun layout with a tab for each run: curve and events if any, and plots of
    signals.
    """
    tabs = [_run_tab(run) for run in runs]
    text_view = rrb.TextDocumentView(origin="/verdict", name="verdict")
    return rrb.Blueprint(
        rrb.Vertical(text_view, rrb.Tabs(*tabs, active_tab=0), row_shares=[1, 6]),
        rrb.TimePanel(timeline="t", state="collapsed"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        auto_views=False,
        auto_layout=False,
    )


def _run_tab(run: Replay) -> Any:
    """Tab of one run: its curve and events on the left, its signals on the right."""
    name = f"{run.name} (held out)" if run.held_out else run.name
    root = _root(run.name)
    titles = dict.fromkeys(
        s.title for scene in run.scenes.values() for s in scene.signals
    )
    plots = [
        rrb.TimeSeriesView(
            origin=f"{root}/signals/{rr.escape_entity_path_part(title)}",
            name=title,
            plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.RightTop),
        )
        for title in titles
    ]
    if run.measured.curve is None:
        return rrb.Grid(*plots, grid_columns=2, name=name)
    side = rrb.Spatial2DView(
        origin=root,
        contents=[
            "$origin/curve/**",
            "$origin/tracks/**",
            "$origin/path",
            "$origin/desk",
        ],
        name="strip [mm]: measured (amber), before (red), after (blue)",
    )
    log = rrb.TextLogView(origin=f"{root}/events", name="events")
    left = rrb.Vertical(side, log, row_shares=[4, 1])
    return rrb.Horizontal(left, rrb.Vertical(*plots), name=name)


def _log_run(recording: rr.RecordingStream, run: Replay) -> None:
    """Log the signals, curve, tracks and events of a run, measured and simulated."""
    root = _root(run.name)
    if run.measured.curve is not None:
        _log_surroundings(recording, root, run.measured)
    for word, scene in run.scenes.items():
        _log_signals(recording, root, word, scene)
        _log_curve(recording, root, word, scene)
        for name, track in scene.tracks.items():
            colour = HAND_RGBA if name == "gripper" else CURVE_COLOURS[word]
            size = 4 * RADIUS_MM if word == "measured" else 3 * RADIUS_MM
            columns = rr.Points2D.columns(positions=_flat_points(track.places))
            look = rr.Points2D.from_fields(colors=colour, radii=size)
            _send_columns(
                recording, f"{root}/tracks/{name}/{word}", track.t, columns, look
            )
        for t, words in scene.events:
            recording.set_time("t", duration=t)
            recording.log(f"{root}/events/{word}", rr.TextLog(f"{word}: {words}"))
            recording.reset_time()


def _log_surroundings(
    recording: rr.RecordingStream, root: str, measured: Scene
) -> None:
    """Log the desk's surface and the gripper's path as lines."""
    grip = measured.tracks["gripper"].places
    desk = _flat_points(np.array([[-0.1, 0.0], [float(grip[:, 0].max()) + 0.15, 0.0]]))
    lines = (("desk", desk, DESK_RGBA), ("path", _flat_points(grip), HAND_RGBA))
    for name, points, colour in lines:
        line = rr.LineStrips2D([points], colors=colour, radii=0.4 * RADIUS_MM)
        recording.log(f"{root}/{name}", line, static=True)


def _log_signals(
    recording: rr.RecordingStream, root: str, word: str, scene: Scene
) -> None:
    for signal in scene.signals:
        entity = f"{root}/signals/{rr.escape_entity_path_part(signal.title)}/{word}"
        look = rr.SeriesLines(colors=CURVE_COLOURS[word], names=word, widths=1.5)
        _send_columns(
            recording, entity, signal.t, rr.Scalars.columns(scalars=signal.values), look
        )


def _log_curve(
    recording: rr.RecordingStream, root: str, word: str, scene: Scene
) -> None:
    """Log a measured curve as unconnected points, a simulated one as a line."""
    if scene.curve is None or not len(scene.curve.t):
        return
    curves = [_flat_points(points) for points in scene.curve.points]
    if word == "measured":
        columns = rr.Points2D.columns(positions=np.concatenate(curves))
        columns = columns.partition([len(points) for points in curves])
        look: Any = rr.Points2D.from_fields(
            colors=CURVE_COLOURS[word], radii=1.4 * RADIUS_MM
        )
    else:
        columns = rr.LineStrips2D.columns(strips=curves)
        look = rr.LineStrips2D.from_fields(
            colors=CURVE_COLOURS[word], radii=0.7 * RADIUS_MM
        )
    _send_columns(recording, f"{root}/curve/{word}", scene.curve.t, columns, look)


def _send_columns(
    recording: rr.RecordingStream, entity: str, t: Array, columns: Any, look: Any
) -> None:
    """Log the rows of a Rerun `entity` at times `t` (m,) [s]; nothing without rows."""
    if len(t):
        recording.log(entity, look, static=True)
        recording.send_columns(entity, [rr.TimeColumn("t", duration=t)], columns)


def _root(name: str) -> str:
    return f"/{rr.escape_entity_path_part(name)}"


def _flat_points(points: Array) -> Array:
    """Points (k, 2) of x, z [m] converted to view axes [mm], of which the second points
    down.
    """
    return points * (1e3, -1e3)
