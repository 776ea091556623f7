"""Rerun recording `overlay.rrd`: runs as measured, and as simulated before and after.

Of run NAME: /NAME/world/curve, /NAME/world/tracks and /NAME/signals, each with
`measured`, `before` (the refitted base) and `after` (the accepted model), on the run's
own time `t`, and /NAME/events. The sentence of the verdict is in /verdict.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from cell.gap.report.figures import COLOUR_AFTER, COLOUR_BEFORE, RunScenes, replay
from cell.gap.report.sentence import headline, sentence
from cell.gap.subject.subject import Scene
from cell.gap.verdict.findings import Findings
from cell.gap.verdict.schema import Verdict
from cell.report.viz import saving, scene
from drivers.base.errors import ConfigurationError
from drivers.base.files import replacing
from drivers.base.installation import Installation
from drivers.base.types import Array

CURVE_COLOURS = {
    "measured": 0xF2F3F5FF,
    "before": int(COLOUR_BEFORE[1:] + "ff", 16),
    "after": int(COLOUR_AFTER[1:] + "ff", 16),
}
# m before the strip's near edge, so that no curve hides another
DEPTHS = {"measured": 0.0, "before": scene.APART, "after": 2 * scene.APART}
WIDTH = 0.05  # m, of desk and clamp that are drawn for a strip
POINT_RADIUS, CONTACT_RADIUS, HAND_RADIUS, CURVE_RADIUS = (
    0.003,
    0.006,
    0.012,
    0.0022,
)  # m
NEARNESS = 0.72  # of the eye: there is no arm to be seen
AFTER = 0.05  # s after the last reading, when nothing is shown any more


def write_overlay(findings: Findings, verdict: Verdict, path: Path) -> None:
    """Write a Rerun recording at `path` that shows the runs of a fit as measured and as
    simulated; ConfigurationError where that fails.
    """
    words = f"## {headline(verdict)}\n\n{sentence(findings, verdict)}"
    write_recording(findings.subject.name, list(replay(findings)), path, words)


def write_recording(
    name: str, runs: Sequence[RunScenes], path: Path, words: str
) -> None:
    """Write a Rerun recording at `path` of the `runs` of the strip or mechanism called
    `name`, with the text `words` on the verdict; ConfigurationError where that fails.
    """
    recording = rr.RecordingStream("cell gap", recording_id=f"gap-{name}")
    try:
        with replacing(path) as scratch, saving.saving(recording, scratch):
            saving.send_blueprint(recording, blueprint(runs))
            recording.log("verdict", saving.document(words), static=True)
            for run in runs:
                _log_run(recording, run)
    except (OSError, RuntimeError, ValueError) as error:
        raise ConfigurationError(f"{path}: cannot be written: {error}") from None


def blueprint(runs: Sequence[RunScenes]) -> Any:
    """Layout of the Rerun viewer with a tab for each run, which shows its curve and
    events, if it has any, and plots of its signals.
    """
    return saving.blueprint(rrb.Tabs(*map(_run_tab, runs), active_tab=0))


def _run_tab(run: RunScenes) -> Any:
    """Tab of the Rerun viewer for one run, with its curve above its events and the
    verdict, beside plots of its signals.
    """
    name = run.name
    root = _root(name)
    title = f"{name} (held out)" if run.held_out else name
    signals = (
        signal.title for drawn in run.scenes.values() for signal in drawn.signals
    )
    plots = [saving.curves(_signal(root, s), s) for s in dict.fromkeys(signals)]
    verdict = rrb.TextDocumentView(origin="/verdict", name="verdict")
    if not run.measured.curve:
        grid = rrb.Grid(*plots, grid_columns=2)
        return rrb.Vertical(verdict, grid, row_shares=[1, 6], name=title)

    log = rrb.TextLogView(origin=f"{root}/events", name="events")
    legend = "strip: measured (white), before (orange), after (blue)"
    place = f"{root}/{scene.WORLD}"
    space = scene.view(_length(run), place, legend, nearness=NEARNESS)
    views = saving.arrange(space, log, verdict, plots, [1] * len(plots))
    return rrb.Horizontal(views, name=title)


def _log_run(recording: rr.RecordingStream, run: RunScenes) -> None:
    """Log the signals, curve, moving points and events of a run into a Rerun recording,
    as measured and as simulated.
    """
    root = _root(run.name)
    world = f"{root}/{scene.WORLD}"
    if run.measured.curve:
        _log_surroundings(recording, world, run)
    for word, drawn in run.scenes.items():
        _log_signals(recording, root, word, drawn)
        _log_curve(recording, world, word, drawn)
        _log_tracks(recording, world, word, drawn)
        for t, words in drawn.events:
            recording.set_time("t", duration=t)
            recording.log(f"{root}/events/{word}", rr.TextLog(f"{word}: {words}"))
            recording.reset_time()


def _log_surroundings(recording: rr.RecordingStream, root: str, run: RunScenes) -> None:
    """Log the desk and the clamp of a run into a Rerun recording, and the gripper's
    path as a line.
    """
    bodies = scene.surroundings(_length(run), WIDTH, Installation())
    for entity, body in bodies.items():
        under = entity.removeprefix(scene.WORLD)
        recording.log(f"{root}{under}", body, static=True)
    path = scene.at_depth(run.measured.tracks["gripper"].places, 0.0)
    line = rr.LineStrips3D([path], colors=scene.PATH_RGBA, radii=scene.LINE)
    recording.log(f"{root}/path", line, static=True)


def _length(run: RunScenes) -> float:
    """Length [m] of the strip of a run, taken as the largest distance of the gripper
    from the strip's fixed edge.
    """
    return float(run.measured.tracks["gripper"].places[:, 0].max())


def _log_tracks(
    recording: rr.RecordingStream, root: str, word: str, drawn: Scene
) -> None:
    """Log the moving points of the scene `drawn` into a Rerun recording, the gripper as
    a larger one than the desk contact.
    """
    for name, track in drawn.tracks.items():
        is_hand = name == "gripper"
        colour = scene.PATH_RGBA if is_hand else CURVE_COLOURS[word]
        size = HAND_RADIUS if is_hand else CONTACT_RADIUS
        points = scene.at_depth(track.places, -DEPTHS[word])
        columns = rr.Points3D.columns(positions=points)
        look = rr.Points3D.from_fields(colors=colour, radii=size)
        _send_shapes(
            recording,
            entity=f"{root}/tracks/{name}/{word}",
            t=track.t,
            columns=columns,
            look=look,
        )


def _log_signals(
    recording: rr.RecordingStream, root: str, word: str, drawn: Scene
) -> None:
    look = rr.SeriesLines(colors=CURVE_COLOURS[word], names=word, widths=1.5)
    for title, t, values in drawn.signals:
        columns = rr.Scalars.columns(scalars=values)
        _send_columns(
            recording,
            entity=f"{_signal(root, title)}/{word}",
            t=t,
            columns=columns,
            look=look,
        )


def _log_curve(
    recording: rr.RecordingStream, root: str, word: str, drawn: Scene
) -> None:
    """Log the curve of the scene `drawn` into a Rerun recording, as separate points
    where it was measured, as a line where it is simulated.
    """
    curve = drawn.curve
    if not (curve and len(curve.t)):
        return

    t, places = curve
    depth = -DEPTHS[word]
    colour = CURVE_COLOURS[word]
    curves = [scene.at_depth(points, depth) for points in places]
    if word == "measured":
        columns = rr.Points3D.columns(positions=np.concatenate(curves))
        columns = columns.partition([*map(len, curves)])
        look: Any = rr.Points3D.from_fields(colors=colour, radii=POINT_RADIUS)
    else:
        columns = scene.lines(curves)
        look = rr.LineStrips3D.from_fields(colors=colour, radii=CURVE_RADIUS)

    _send_shapes(
        recording, entity=f"{root}/curve/{word}", t=t, columns=columns, look=look
    )


def _send_columns(
    recording: rr.RecordingStream, entity: str, t: Array, columns: Any, look: Any
) -> None:
    """Log a Rerun `entity` with one state for each of the times `t` [s]; nothing where
    there are no times.
    """
    if not len(t):
        return
    recording.log(entity, look, static=True)
    recording.send_columns(entity, [rr.TimeColumn("t", duration=t)], columns)


def _send_shapes(
    recording: rr.RecordingStream, entity: str, t: Array, columns: Any, look: Any
) -> None:
    """Log a shape with one state for each of the times `t` [s], the first already seen
    as the recording opens; the shape vanishes after the last.
    """
    if not len(t):
        return
    _send_columns(
        recording,
        entity,
        t=np.array([min(0.0, t[0]), *t[1:]]),
        columns=columns,
        look=look,
    )
    recording.set_time("t", duration=t[-1] + AFTER)
    recording.log(entity, rr.Clear(recursive=False))
    recording.reset_time()


def _signal(root: str, title: str) -> str:
    """Path, in a Rerun recording, of the plot of signals with the given `title`, below
    the path `root` of its run.
    """
    return f"{root}/signals/{rr.escape_entity_path_part(title)}"


def _root(name: str) -> str:
    return f"/{rr.escape_entity_path_part(name)}"
