"""Recording of a run for the viewer Rerun, written during the run or from its record.

A strip simulated by its model, driven by the measured gripper, is drawn beside the
measured one.
"""

import math
import os
import socket
import subprocess
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from calibration.calibration import Calibration
from cell.base.config.places import cache_folder
from cell.perception.strip_measurement import StripMeasurement
from cell.record.events import COLUMN_NAMES, origin_of, read_events
from cell.record.files import FILM, RECORDING, RESULT, RUN, is_under_way
from cell.record.frames import read_index
from cell.record.run import Run, read_broken_run
from cell.report.figures import PANELS, STATE_SHADES
from cell.report.page_verdict import LINE_BREAK, verdict_of
from cell.report.viz.playback import LogLine, TickView, moments_of
from cell.report.viz.saving import saving, send_blueprint
from drivers.base.errors import ConfigurationError, Fault, Unsupported
from drivers.base.files import replacing
from drivers.base.settings import parse
from drivers.base.types import Array, Image
from drivers.strip.describe import describe
from drivers.strip.file import StripFile
from drivers.strip.rod.engine import Rod

BATCH_TICKS = 20  # ticks that are sent together
TICKS_BETWEEN_POSES = 4  # ticks between two poses of gripper and model
VIEWER_MEMORY, SERVER_MEMORY = "2GB", "256MB"
SEEN_RGBA = 0xFFAA32FF
MODEL_RGBA = 0x4F8BD6FF
HAND_RGBA = 0xC9CED6FF
CONTACT_RGBA = 0x2882FFFF
TIP_RGBA = 0x6ED25AFF
MM = 1e3  # per m: lengths are shown in mm
TO_VIEW = np.array([MM, -MM])  # of a flat view, whose second axis points down
HAND_SIGNALS = {"along/gripper_x": HAND_RGBA, "above/gripper_z": HAND_RGBA}
SEEN_SIGNALS = {
    "along/contact_x": CONTACT_RGBA,
    "along/tip_x": TIP_RGBA,
    "above/tip_z": TIP_RGBA,
}
SEEN_SIGNALS |= {"above/gap": SEEN_RGBA}
OUTLOOK_SIGNALS = {f"outlook/{name}": MODEL_RGBA for name in COLUMN_NAMES}
OUTLOOK_SIGNALS["outlook/displacement"] = SEEN_RGBA
# units: mm, ms, 1/m
SIGNAL_SCALES = {
    name: 1.0 if "yield_curvature" in name else MM for name in OUTLOOK_SIGNALS
}
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
    try:
        layout = blueprint(filmed=(folder / FILM).is_file())
        with (
            replacing(path) as scratch,
            open_recording("cell", scratch, layout) as recording,
        ):
            screen = Screen(recording, run.calibration(), strip)
            for item in moments_of(run):
                screen.draw(item)
            screen.finish()
            if (folder / RESULT).is_file():
                screen.log_verdict(run)
            with suppress(ValueError):  # a film that broke off
                screen.log_film(folder)
    except (OSError, RuntimeError, ValueError) as error:
        raise ConfigurationError(f"{path}: cannot be written: {error}") from None
    return path


@contextmanager
def open_recording(
    application: str, path: Path, layout: rrb.Blueprint, *, live: bool = False
) -> Iterator[rr.RecordingStream]:
    """Open a Rerun recording with a `layout` in the file at `path`; complete after the
    block.

    `live` also serves it on loopback and starts Rerun's viewer there. Raises OSError,
    RuntimeError or ValueError where the file cannot be written.
    """
    recording = rr.RecordingStream(
        application, recording_id=ascii(path.parent.name).strip("'")
    )
    servers = []
    if live:
        memory = SERVER_MEMORY
        servers = [
            rr.GrpcServerSink("127.0.0.1", free_port(), server_memory_limit=memory)
        ]
    with saving(recording, path, *servers):
        for server in servers:
            with suppress(OSError):  # without a viewer the file is still written
                open_viewer(server.uri)
        send_blueprint(recording, layout)
        yield recording


def open_viewer(address: str) -> None:
    """Start Rerun's viewer on `address` as an independent process that reports no
    usage.
    """
    command = [sys.executable, "-m", "rerun_cli"]
    quiet: dict[str, Any] = dict.fromkeys(
        ("stdin", "stdout", "stderr"), subprocess.DEVNULL
    )
    quiet["env"] = {**os.environ, "XDG_CONFIG_HOME": str(cache_folder() / "viewer")}
    subprocess.run([*command, "analytics", "disable"], check=False, **quiet)  # noqa: S603  ours
    arguments = ("--connect", address, "--memory-limit", VIEWER_MEMORY)
    subprocess.Popen([*command, *arguments], start_new_session=True, **quiet)  # noqa: S603  ours


class Signals:
    """Group of signals of a recording, buffered over ticks and sent to it in one
    piece.
    """

    def __init__(self, names: Iterable[str]) -> None:
        self._names = tuple(names)
        self._times: list[float] = []
        self._ticks: list[int] = []
        self._rows: list[Sequence[float]] = []

    def __len__(self) -> int:
        return len(self._rows)

    def add(self, tick: TickView, values: Sequence[float]) -> None:
        """Buffer the signals' `values` in SI units at a `tick` of the run."""
        self._times.append(tick.t)
        self._ticks.append(tick.tick)
        self._rows.append(values)

    def send(self, recording: rr.RecordingStream) -> None:
        """Send the buffered values to `recording`, in the units of its plots."""
        if not self._rows:
            return
        times = [
            rr.TimeColumn("t", duration=self._times),
            rr.TimeColumn("tick", sequence=self._ticks),
        ]
        for name, signal in zip(self._names, np.array(self._rows).T, strict=True):
            columns = rr.Scalars.columns(scalars=SIGNAL_SCALES.get(name, MM) * signal)
            recording.send_columns(f"signals/{name}", times, columns)
        for buffered in (self._times, self._ticks, self._rows):
            buffered.clear()


class Screen:
    """Writer of ticks and log lines into a Rerun recording, which owns its entity
    paths.
    """

    def __init__(
        self,
        recording: rr.RecordingStream,
        calibration: Calibration | None,
        strip: StripFile | None,
    ) -> None:
        """Draw into `recording`: images with a `calibration`, a model with a
        `strip`.
        """
        self._to = recording
        self._calibration = calibration
        self._shadow = None if strip is None else Shadow(strip)
        self._hand = Signals(HAND_SIGNALS)
        self._seen = Signals(SEEN_SIGNALS)
        self._outlook = Signals(OUTLOOK_SIGNALS)
        self._track: list[Array] = []
        # with whether measured time had begun
        self._drawn_state: tuple[str, bool] = ("", False)
        self._log_surroundings(1.0 if strip is None else strip.length)

    def draw(self, item: TickView | LogLine) -> None:
        """Draw a tick of the run, or add a line to the recording's log."""
        self._to.reset_time()
        self._to.set_time("clock", duration=item.clock)
        if math.isfinite(item.t):
            self._to.set_time("t", duration=item.t)
        if isinstance(item, LogLine):
            level = rr.TextLogLevel.ERROR if item.alarm else rr.TextLogLevel.INFO
            self._to.log("log", rr.TextLog(item.text, level=level))
        else:
            self._draw_tick(item)

    def _draw_tick(self, tick: TickView) -> None:
        """Draw what changed in a tick: state, image, measurement, prediction and
        motion.
        """
        self._to.set_time("tick", sequence=tick.tick)
        has_begun = math.isfinite(tick.t)
        if tick.state and (tick.state, has_begun) != self._drawn_state:
            self._drawn_state = (tick.state, has_begun)
            self._to.log("cell/state", rr.StateChange(state=tick.state))
        if tick.image is not None:
            self._to.log("camera/image", jpeg(tick.image))
        if tick.measurement is not None and self._calibration is not None:
            self._draw_overlay(tick.measurement, self._calibration)
        elif tick.image is not None:
            self._to.log("camera/overlay", rr.Clear(recursive=True))
        if not has_begun:
            return
        if tick.measurement is not None:
            seen = tick.measurement
            self._seen.add(tick, [seen.contact_x, *seen.tip, seen.gap])
            self._to.log("strip/measured", _curve(seen.profile, SEEN_RGBA, 2.0))
        if tick.outlook is not None:
            self._outlook.add(tick, tick.outlook.tolist())
        self._draw_motion(tick)

    def finish(self) -> None:
        """Send the signals that are still buffered."""
        for signals in (self._hand, self._seen, self._outlook):
            signals.send(self._to)

    def log_verdict(self, run: Run) -> None:
        """Add the text of the verdict on `run`."""
        verdict = verdict_of(run, None)
        error = verdict.error.replace(LINE_BREAK, ", ")
        figure = [f"**{verdict.figure}** ({error})"] if verdict.figure else []
        text = "\n\n".join([f"# {verdict.headline}", *figure, *verdict.sentences])
        document = rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN)
        self._to.log("verdict", document, static=True)

    def log_film(self, folder: Path) -> None:
        """Add the film of the run in `folder`, each image at its time; ValueError if no
        film.
        """
        path = folder / FILM
        notes = read_index(folder) if path.is_file() else ()
        if not any(note.film is not None for note in notes):
            return
        film = rr.AssetVideo(path=path)
        taken = film.read_frame_timestamps_nanos()
        shown = [
            note for note in notes if note.film is not None and note.film < len(taken)
        ]
        stamps = np.array([note.stamp for note in shown])
        clock = stamps + origin_of(read_events(folder))
        self._to.log("camera/film", film, static=True)
        self._to.send_columns(
            "camera/film",
            [
                rr.TimeColumn("t", duration=stamps),
                rr.TimeColumn("clock", duration=clock),
            ],
            rr.VideoFrameReference.columns_nanos(taken[[note.film for note in shown]]),
        )

    def _log_surroundings(self, length: float) -> None:
        """Draw static parts: the desk, names and colours of states and signals."""
        desk = [MM * np.array([(-0.1, 0.0), (length + 0.15, 0.0)])]
        self._to.log(
            "desk", rr.LineStrips2D(desk, colors=0x8A9099FF, radii=1.0), static=True
        )
        lanes = rr.StateConfiguration(
            values=list(STATE_COLOURS), colors=list(STATE_COLOURS.values())
        )
        self._to.log("cell/state", lanes, static=True)
        for name, colour in (HAND_SIGNALS | SEEN_SIGNALS | OUTLOOK_SIGNALS).items():
            label = name.partition("/")[2].replace("_", " ")
            line = rr.SeriesLines(colors=colour, names=label, widths=1.5)
            self._to.log(f"signals/{name}", line, static=True)

    def _draw_overlay(
        self, measurement: StripMeasurement, calibration: Calibration
    ) -> None:
        """Draw profile, contact and fold tip over the camera's image."""
        pixels = calibration.to_image(measurement.profile)
        self._to.log(
            "camera/overlay/profile",
            rr.LineStrips2D([pixels], colors=SEEN_RGBA, radii=1.5),
        )
        marks = np.array([(measurement.contact_x, 0.0), measurement.tip])
        seen = np.isfinite(marks).all(axis=1)
        colours = np.array([CONTACT_RGBA, TIP_RGBA], dtype=np.uint32)[seen]
        points = rr.Points2D(calibration.to_image(marks[seen]), colors=colours, radii=6)
        self._to.log("camera/overlay/marks", points)

    def _draw_motion(self, moment: TickView) -> None:
        """Draw the gripper, its path and the simulated strip."""
        place = moment.pose[:2]
        self._hand.add(moment, place.tolist())
        shape = NO_SHAPE
        if self._shadow is not None:
            shape = self._shadow.follow(moment.t, moment.pose)
        if moment.tick % TICKS_BETWEEN_POSES == 0:
            self._track.append(TO_VIEW * place)
            self._to.log(
                "gripper", rr.Points2D([TO_VIEW * place], colors=HAND_RGBA, radii=6.0)
            )
            self._to.log("strip/twin", _curve(shape, MODEL_RGBA, 1.2))
        if len(self._hand) >= BATCH_TICKS:
            track = rr.LineStrips2D([self._track], colors=HAND_RGBA, radii=0.8)
            self._to.log("gripper/path", track)
            self.finish()


def _curve(points: Array, colour: int, radius: float) -> Any:
    """Line through points (n, 2) [m] for a flat view, drawn with `radius` [mm]."""
    lines = [TO_VIEW * points] if len(points) > 1 else []
    return rr.LineStrips2D(lines, colors=colour, radii=radius)


def jpeg(image: Image) -> Any:
    """Compress `image` (h, w, 3) BGR as a JPEG for Rerun."""
    _, content = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 70])
    return rr.EncodedImage(contents=bytes(content), media_type="image/jpeg")


def free_port() -> int:
    """Number of a free TCP port on the loopback."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def blueprint(*, filmed: bool) -> Any:
    """Layout of Rerun's viewer for a run: camera or film, side view, states, signals
    and log.
    """
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
        rrb.Spatial2DView(
            origin="/camera", contents=["/camera/image", drawn], name="camera"
        ),
        rrb.Spatial2DView(
            origin="/camera", contents=["/camera/film", drawn], name="film"
        ),
        active_tab=int(filmed),
    )
    return rrb.Blueprint(
        rrb.Horizontal(rrb.Vertical(camera, side), right),
        rrb.TimePanel(timeline="t", state="collapsed"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
    )


def _outlook() -> Any:
    """Tabs of the policy's predictions: displacement and each parameter, with their
    intervals.
    """
    views = [
        rrb.TimeSeriesView(
            origin="/signals/outlook",
            contents=[f"/signals/outlook/{name}{end}" for end in ("", "_low", "_high")],
            name=title,
        )
        for name, (title, _, _) in PANELS.items()
    ]
    return rrb.Tabs(*views, active_tab=0)


def _plot(group: str, name: str, corner: rrb.Corner2D) -> Any:
    legend = rrb.PlotLegend(corner=corner)
    return rrb.TimeSeriesView(origin=f"/signals/{group}", name=name, plot_legend=legend)


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
        return np.asarray(self._rod.shapes()[0])

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
