"""Recording of a run for the viewer Rerun, written during the run or from its record.

A strip simulated by its model, driven by the measured gripper, is drawn beside the
measured one.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.compute as pc
import rerun as rr
import rerun.blueprint as rrb

from calibration.calibration import Calibration
from cell.perception.strip_measurement import StripMeasurement
from cell.record.events import COLUMN_NAMES
from cell.record.files import JOINTS, RECORDING, RUN, is_under_way
from cell.record.run import Run, read_broken_run
from cell.report.figures import PANELS, READING, STATE_SHADES
from cell.report.html import jpeg
from cell.report.page_verdict import key_figures, verdict_of
from cell.report.viz import saving, scene
from cell.report.viz.opening import open_recording
from cell.report.viz.playback import LogLine, TickView, moments_of
from cell.report.viz.scene import MODEL_RGBA, PATH_RGBA, SEEN_RGBA
from drivers.base.errors import ConfigurationError, Fault, Unsupported
from drivers.base.files import replacing
from drivers.base.installation import Installation
from drivers.base.readers import read_parquet
from drivers.base.settings import parse
from drivers.base.types import Array, Image
from drivers.strip.describe import describe
from drivers.strip.file import StripFile
from drivers.strip.rod.engine import Rod

BATCH_TICKS = 20  # ticks that are sent together while the run goes on
TICKS_BETWEEN_POSES = 4  # ticks between two poses of gripper and model
ARM_STEP = 40  # ticks of the robot between two poses of its arm
PICTURE_WIDTH = 640  # px
STALE = 0.3  # s after which a measurement does not show the strip any more
CONTACT_RGBA, TIP_RGBA = 0x2882FFFF, 0x6ED25AFF
MM = 1e3  # per m: lengths are shown in mm
COLOURS_SAID = "strip measured (orange) and simulated (blue)"
UNKNOWN_SIZE = (1.0, 0.05)  # m, of a strip that is not known
# corners x, z of what is shown of the image, in lengths of the strip
VIEW_LOW, VIEW_HIGH = (-0.12, -0.1), (1.12, 0.68)

MEASURED, SIMULATED = f"{scene.WORLD}/strip/measured", f"{scene.WORLD}/strip/simulated"
MEASURED_EDGE = f"{MEASURED}/edge"
PICTURE = f"{scene.IMAGE}/picture"
OVERLAY = f"{scene.IMAGE}/overlay"
PROFILE, CONTACT, TIP = f"{OVERLAY}/profile", f"{OVERLAY}/contact", f"{OVERLAY}/tip"
STATE, VERDICT, LOG = "state", "verdict", "log"
HAND = scene.LINKS[scene.HAND_LINK]
OF_STRIP, OF_IMAGE = (MEASURED, MEASURED_EDGE), (PROFILE, CONTACT, TIP)

# names and colours of curves by entity
CURVES = {
    "along/gripper_x": ("gripper", PATH_RGBA),
    "along/contact_x": ("desk contact", CONTACT_RGBA),
    "along/tip_x": ("fold tip", TIP_RGBA),
    "above/gripper_z": ("gripper", PATH_RGBA),
    "above/tip_z": ("fold tip", TIP_RGBA),
    "above/gap": ("gap of the layers", SEEN_RGBA),
}
HAND_CURVES = ("along/gripper_x", "above/gripper_z")
SEEN_CURVES = ("along/contact_x", "along/tip_x", "above/tip_z", "above/gap")
BOUNDS = {"": "predicted", "_low": "less one sigma", "_high": "plus one sigma"}
CURVES |= {
    f"outlook/{name}{end}": (words, MODEL_RGBA if end else SEEN_RGBA)
    for name in PANELS
    for end, words in BOUNDS.items()
}
OUTLOOK_CURVES = tuple(f"outlook/{name}" for name in COLUMN_NAMES)
# units: mm, ms, 1/m
SCALES = {name: 1.0 if "yield_curvature" in name else MM for name in CURVES}

STATE_COLOURS = {
    state: int(shade[1:] + "ff", 16) for state, shade in STATE_SHADES.items()
}
STEP = 0.005  # s of the simulated rod
TIME_ROUNDING = 1e-9  # s
SEGMENTS = 60  # of the simulated rod
# s without a measured gripper, where the model ends
LONGEST_START, LONGEST_GAP = 10.0, 1.0
LIFTED_HEIGHT = 0.02  # m, above which a strip's first pose is one that hangs
NO_SHAPE = np.empty((0, 2))

Compose = Callable[[list[Any]], Any]  # of rows into Rerun's columns


def viz_from_run(folder: Path) -> Path:
    """Write the Rerun recording of the run in `folder` from its record; returns its
    path.

    Broken parts of the record are left out. Raises ConfigurationError for a folder that
    cannot be read as a run or cannot be written, and for a run under way.
    """
    run = read_broken_run(folder)
    if is_under_way(folder):
        raise ConfigurationError(f"{folder}: is still under way; let it finish")
    path = folder / RECORDING
    stated = run.header.strip_file
    strip = (
        None
        if stated is None
        else parse(stated, StripFile, f"{folder / RUN}: strip_file")
    )
    calibration = run.calibration()
    end = float(run.ticks.t[-1]) if run.ticks.t.size else None
    views = layout(strip, calibration, end=end)
    try:
        with (
            replacing(path) as scratch,
            open_recording("cell", scratch, views) as recording,
        ):
            screen = RerunWriter(recording, calibration, strip, batch=math.inf)
            screen.begin(run)
            for item in moments_of(run):
                screen.draw(item)
            screen.finish(run)
    except (OSError, RuntimeError, ValueError) as error:
        raise ConfigurationError(f"{path}: cannot be written: {error}") from None
    return path


class Rows:
    """Rows of one entity of a Rerun recording, buffered over time and sent in one
    piece.
    """

    def __init__(self, entity: str, compose: Compose) -> None:
        """Buffer rows of `entity`, which `compose` turns into Rerun's columns."""
        self._entity = entity
        self._compose = compose
        self._t: list[float] = []
        self._clock: list[float] = []
        self._rows: list[Any] = []

    def add(self, moment: TickView | LogLine, row: Any) -> None:
        """Buffer a `row` at a `moment` of the run; all before t = 0 stands there."""
        self._t.append(max(0.0, moment.t) if math.isfinite(moment.t) else 0.0)
        self._clock.append(moment.clock)
        self._rows.append(row)

    def send(self, recording: rr.RecordingStream) -> None:
        """Send the buffered rows to `recording`."""
        if not self._rows:
            return
        times = _times(self._t, self._clock)
        recording.send_columns(self._entity, times, self._compose(self._rows))
        for buffered in (self._t, self._clock, self._rows):
            buffered.clear()


def _times(t: Any, clock: Any) -> list[rr.TimeColumn]:
    """Time columns of Rerun for rows at `t` (n,) [s] since the lift and at `clock` (n,)
    [s] of the cell.
    """
    timelines = {"t": t, "clock": clock}
    return [rr.TimeColumn(name, duration=at) for name, at in timelines.items()]


class RerunWriter:
    """Writer of a run into a Rerun recording, which owns its entities."""

    def __init__(
        self,
        recording: rr.RecordingStream,
        calibration: Calibration | None,
        strip: StripFile | None,
        batch: float = BATCH_TICKS,
    ) -> None:
        """Draw into `recording`: images with a `calibration`, a model with a `strip`.

        Rows are sent after every `batch` of ticks.
        """
        self._to = recording
        self._calibration = calibration
        self._strip = strip
        self._length, self._width = _size(strip)
        self._shadow = None if strip is None else Shadow(strip)
        self._batch = batch
        self._waiting = 0
        self._rows: dict[tuple[str, Compose], Rows] = {}
        self._track: list[Array] = []
        self._state = ""
        self._seen_at = math.nan
        self._last_t = -math.inf
        self._is_modelled = False
        self._scale = 1.0
        self._has_joints = False
        self._has_picture = False

    def begin(self, run: Run) -> None:
        """Draw the parts of a `run` that stand still, such as desk and camera."""
        cell = _installation_of(run)
        self._has_joints = (run.folder / JOINTS).is_file()
        desk = scene.surroundings(self._length, self._width, cell)
        bodies = {**desk, **scene.hand_bodies()}
        if self._calibration is not None:
            self._scale = PICTURE_WIDTH / self._calibration.lens.width
            bodies |= scene.camera(self._calibration, self._scale)
        if self._strip is not None:
            bodies |= {MEASURED: scene.strip_look(self._strip.colour)}
        for entity, body in {**bodies, **_looks()}.items():
            self._to.log(entity, body, static=True)
        self._to.log(VERDICT, saving.document("# Under way"), static=True)

    def draw(self, item: TickView | LogLine) -> None:
        """Draw a tick of the run, or add a line to the recording's log."""
        if isinstance(item, LogLine):
            self._add(LOG, _log_columns, item, (item.text, item.alarm))
            return
        self._draw_tick(item)
        self._waiting += 1
        if self._waiting >= self._batch:
            self._send()

    def finish(self, run: Run) -> None:
        """Send the rows still buffered, and add what the record of `run` knows at its
        end.
        """
        self._send()
        self._draw_arm(run)
        self._to.log(VERDICT, saving.document(_verdict_text(run)), static=True)

    def _draw_tick(self, tick: TickView) -> None:
        """Draw what changed in a tick: state, image, measurement, prediction and
        motion.
        """
        state = tick.state
        if state and state != self._state:
            self._state = state
            self._add(STATE, _state_columns, tick, state)
        if tick.image is not None:
            self._draw_picture(tick, tick.image)
        is_due = tick.tick % TICKS_BETWEEN_POSES == 0
        if is_due and not self._has_joints and np.isfinite(tick.pose).all():
            frame = scene.hand_frame(tick.pose, self._width)
            self._add(HAND, _frame_columns, tick, frame)
        if not math.isfinite(tick.t):
            return
        self._last_t = tick.t
        if tick.measurement is not None:
            self._draw_measurement(tick, tick.measurement)
        elif tick.t > self._seen_at + STALE:
            self._clear_measurement(tick)
        if tick.outlook is not None:
            self._add_curves(tick, OUTLOOK_CURVES, tick.outlook.tolist())
        self._draw_motion(tick)

    def _draw_measurement(self, tick: TickView, seen: StripMeasurement) -> None:
        """Draw the measured strip and its curves."""
        self._add_curves(tick, SEEN_CURVES, [seen.contact_x, *seen.tip, seen.gap])
        if len(seen.profile) < 2:
            return
        begins, self._seen_at = math.isnan(self._seen_at), tick.t
        moment = replace(tick, t=0.0) if begins else tick
        midline = scene.from_fixed_edge(seen.profile)
        self._add(MEASURED, self._band_columns, moment, midline)
        edge = scene.at_depth(midline, -scene.LINE)
        self._add(MEASURED_EDGE, scene.lines, moment, edge)

    def _draw_picture(self, tick: TickView, image: Image) -> None:
        """Draw a camera image and, where it was measured, the measurement in it."""
        moment = tick if self._has_picture else replace(tick, t=0.0)
        self._has_picture = True
        picture = jpeg(image, PICTURE_WIDTH)
        self._add(PICTURE, _picture_columns, moment, picture)
        seen = tick.measurement
        if seen is None or self._calibration is None:
            self._clear(moment, OF_IMAGE)
            return
        points = np.array([(seen.contact_x, 0.0), seen.tip])
        self._add(PROFILE, _line_columns, moment, self._pixels(seen.profile))
        for entity, point in zip((CONTACT, TIP), points, strict=True):
            self._add(entity, _point_columns, moment, self._pixels(point[None]))

    def _pixels(self, points: Array) -> Array:
        """Pixels (k, 2) of those of `points` (n, 2) [m] that are known, in an image as
        it is shown.
        """
        known = points[np.isfinite(points).all(axis=1)]
        if self._calibration is None or not len(known):
            return NO_SHAPE
        return self._scale * self._calibration.to_image(known)

    def _draw_motion(self, tick: TickView) -> None:
        """Draw the gripper's curves, its path and the simulated strip."""
        position = tick.pose[:2]
        self._add_curves(tick, HAND_CURVES, position.tolist())
        shape = NO_SHAPE
        if self._shadow is not None and self._state in (*READING, ""):
            shape = self._shadow.follow(tick.t, tick.pose)
        if tick.tick % TICKS_BETWEEN_POSES:
            return
        self._track.append(position)
        if len(shape):
            before = scene.at_depth(shape, -scene.APART)
            self._add(SIMULATED, scene.lines, tick, before)
        elif self._is_modelled:
            self._clear(tick, (SIMULATED,))
        self._is_modelled = len(shape) > 0

    def _clear_measurement(self, tick: TickView) -> None:
        """Remove the drawn strip from the recording once its last measurement is too
        old to be true.
        """
        if math.isfinite(self._seen_at):
            self._seen_at = -math.inf
            self._clear(tick, OF_STRIP)

    def _clear(self, tick: TickView, entities: Sequence[str]) -> None:
        for entity in entities:
            self._add(entity, _clear_columns, tick, row=False)

    def _draw_arm(self, run: Run) -> None:
        """Draw the arm at its measured joints, where they are recorded."""
        path = run.folder / JOINTS
        if not path.is_file():
            return
        table = read_parquet(path)
        table = table.filter(pc.field("t") <= self._last_t)
        names = [f"q_{joint}" for joint in range(1, 8)]
        t = table["t"].to_numpy()[::ARM_STEP]
        q = np.column_stack([table[name].to_numpy()[::ARM_STEP] for name in names])
        frames = scene.arm_frames(q, _installation_of(run), self._width)
        for entity, body in scene.arm_bodies().items():
            self._to.log(entity, body, static=True)
        times = _times(np.maximum(t, 0.0), t + run.origin())
        for link, entity in enumerate(scene.LINKS):
            columns = scene.transforms(frames[:, link])
            self._to.send_columns(entity, times, columns)

    def _add_curves(
        self, tick: TickView, names: Sequence[str], values: Sequence[float]
    ) -> None:
        """Buffer `values` in SI units of the curves `names`, in the units of their
        plots.
        """
        for name, value in zip(names, values, strict=True):
            scaled = SCALES.get(name, MM) * value
            self._add(f"signals/{name}", _scalar_columns, tick, scaled)

    def _add(
        self,
        entity: str,
        compose: Compose,
        moment: TickView | LogLine,
        row: Any,
    ) -> None:
        """Buffer a `row` of `entity` at a `moment`."""
        key = (entity, compose)
        if key not in self._rows:
            self._rows[key] = Rows(entity, compose)
        self._rows[key].add(moment, row)

    def _send(self) -> None:
        """Send the rows that wait, and the path up to now."""
        self._waiting = 0
        for rows in self._rows.values():
            rows.send(self._to)
        if self._track:
            middle = 0.5 * self._width
            path = scene.at_depth(np.array(self._track), middle)
            look = rr.LineStrips3D([path], colors=PATH_RGBA, radii=scene.LINE)
            self._to.log(scene.PATH, look, static=True)

    def _band_columns(self, midlines: list[Array]) -> Any:
        return scene.bands(midlines, self._width)


def layout(
    strip: StripFile | None,
    calibration: Calibration | None,
    *,
    end: float | None = None,
    live: bool = False,
) -> rrb.Blueprint:
    """Layout of Rerun's viewer for a run up to time `end` [s], where it is known."""
    axis = None if end is None else _axis(end)
    length, _ = _size(strip)
    hidden = [OVERLAY + "/**", *([scene.CAMERA + "/**"] if calibration is None else [])]
    lanes = rrb.StateTimelineView(origin=STATE, name="state", time_view=axis)
    views = saving.arrange(
        scene.view(length, scene.WORLD, "the cell: " + COLOURS_SAID, hidden),
        _camera_view(length, calibration),
        rrb.TextDocumentView(origin=VERDICT, name="verdict"),
        (
            lanes,
            saving.curves("signals/along", "along the strip [mm]", axis=axis),
            saving.curves("signals/above", "above the desk [mm]", axis=axis),
            _outlook(axis),
            rrb.TextLogView(origin=LOG, name="log", columns=_log_view_columns()),
        ),
        (1.3, 2.2, 2.2, 2.2, 1.6),
    )
    return saving.blueprint(views, live=live)


def _verdict_text(run: Run) -> str:
    """Verdict on `run`, whole, in Markdown."""
    verdict = verdict_of(run)
    numbers = (f"**{n.text}** {n.name}: {n.tolerance}" for n in key_figures(run, {}))
    return "\n\n".join([f"## {verdict.headline}", *numbers, *verdict.sentences])


def _installation_of(run: Run) -> Installation:
    """Installation of the arm with which `run` was recorded, or else a usual one."""
    stated = (run.header.config or {}).get("installation", {})
    return parse(stated, Installation, f"{run.folder / RUN}: config: installation")


def _size(strip: StripFile | None) -> tuple[float, float]:
    """Length and width [m] of a `strip`, or of one that is not known."""
    return UNKNOWN_SIZE if strip is None else (strip.length, strip.width)


def _looks() -> Mapping[str, Any]:
    """Unchanging styles, by entity, of what moves in the recording: lines, marks,
    images, states, curves.
    """
    looks = {
        MEASURED_EDGE: rr.LineStrips3D.from_fields(colors=SEEN_RGBA, radii=scene.EDGE),
        SIMULATED: rr.LineStrips3D.from_fields(colors=MODEL_RGBA, radii=scene.EDGE),
        PICTURE: rr.EncodedImage.from_fields(media_type="image/jpeg"),
        PROFILE: rr.LineStrips2D.from_fields(colors=SEEN_RGBA, radii=1.2),
        CONTACT: rr.Points2D.from_fields(colors=CONTACT_RGBA, radii=4.0),
        TIP: rr.Points2D.from_fields(colors=TIP_RGBA, radii=4.0),
        STATE: rr.StateConfiguration(
            values=list(STATE_COLOURS), colors=list(STATE_COLOURS.values())
        ),
    }
    for name, (words, colour) in CURVES.items():
        look = rr.SeriesLines(colors=colour, names=words, widths=1.5)
        looks[f"signals/{name}"] = look
    return looks


def _camera_view(length: float, calibration: Calibration | None) -> Any:
    """Rerun view of the camera's image with its measurements drawn in, cropped to the
    fold.
    """
    bounds = None
    if calibration is not None:
        scale = PICTURE_WIDTH / calibration.lens.width
        corners = length * np.array([VIEW_LOW, VIEW_HIGH])
        (left, bottom), (right, top) = scale * calibration.to_image(corners)
        bounds = rrb.VisualBounds2D(x_range=[left, right], y_range=[top, bottom])
    return rrb.Spatial2DView(
        origin=scene.IMAGE,
        contents=["$origin/**"],
        name="what the camera saw, and what was read in it",
        visual_bounds=bounds,
    )


def _axis(end: float) -> Any:
    """Time axis of a Rerun view from 0 to `end` [s]."""
    boundary = rr.TimeRangeBoundary.absolute
    span = rr.TimeRange(start=boundary(seconds=0.0), end=boundary(seconds=end))
    return rrb.TimeAxis(view_range=span)


def _outlook(axis: Any) -> Any:
    """Rerun tabs of the policy's predictions: displacement and each parameter, with
    their intervals.
    """
    views = [
        rrb.TimeSeriesView(
            origin="signals/outlook",
            contents=[f"signals/outlook/{name}{end}" for end in BOUNDS],
            name=title,
            axis_x=axis,
        )
        for name, (title, _, _) in PANELS.items()
    ]
    return rrb.Tabs(*views, active_tab=0)


def _log_view_columns() -> Any:
    """Columns of Rerun's view of the log: time and text."""
    return rrb.TextLogColumns(
        timeline_columns=["t"],
        text_log_columns=[rrb.components.TextLogColumn("Body")],
    )


def _scalar_columns(rows: list[float]) -> Any:
    return rr.Scalars.columns(scalars=rows)


def _line_columns(rows: list[Array]) -> Any:
    return rr.LineStrips2D.columns(strips=rows)


def _point_columns(rows: list[Array]) -> Any:
    columns = rr.Points2D.columns(positions=np.concatenate(rows))
    return columns.partition([len(row) for row in rows])


def _picture_columns(rows: list[bytes]) -> Any:
    return rr.EncodedImage.columns(blob=rows)


def _frame_columns(rows: list[Array]) -> Any:
    return scene.transforms(np.array(rows))


def _state_columns(rows: list[str]) -> Any:
    return rr.StateChange.columns(state=rows)


def _clear_columns(rows: list[bool]) -> Any:
    return rr.Clear.columns(is_recursive=rows)


def _log_columns(rows: list[tuple[str, bool]]) -> Any:
    levels = [
        rr.TextLogLevel.ERROR if alarm else rr.TextLogLevel.INFO for _, alarm in rows
    ]
    return rr.TextLog.columns(text=[text for text, _ in rows], level=levels)


class Shadow:
    """Rod simulation that follows the measured gripper of a run from t = 0, flat or
    hanging.
    """

    def __init__(self, strip: StripFile) -> None:
        self._rod = Rod(SEGMENTS)
        self._model = describe(strip)
        self._steps = 0
        self._last: tuple[float, Array] | None = None
        try:
            self._rod.reset([self._model])
            self._lost = False
        except Unsupported:
            self._lost = True

    def follow(self, t: float, pose: Array) -> Array:
        """Midline (nodes, 2) [m] of the rod at time `t` [s], with the gripper at `pose`
        (3,).

        Empty once the model has diverged or the gripper was not measured for too long;
        the rest of the view goes on without it.
        """
        longest = LONGEST_START if self._last is None else LONGEST_GAP
        self._lost = self._lost or t > self._steps * STEP + longest
        if self._lost:
            return NO_SHAPE
        try:
            if self._last is None and pose[1] > LIFTED_HEIGHT:
                self._rod.reset([self._model], pose[None])
            self._step_to(t, pose)
        except Fault:
            self._lost = True
            return NO_SHAPE
        shape: Array = self._rod.shapes()[0]
        return shape

    def _step_to(self, t: float, pose: Array) -> None:
        """Step the rod to `t` [s], the gripper moving linearly from its last pose to
        `pose`.
        """
        last_t, last_pose = self._last or (t, pose)
        self._last = (t, pose)
        while (self._steps + 1) * STEP <= t + TIME_ROUNDING:
            self._steps += 1
            share = (self._steps * STEP - last_t) / max(t - last_t, STEP)
            between = last_pose + np.clip(share, 0.0, 1.0) * (pose - last_pose)
            self._rod.step(between[None], STEP)
