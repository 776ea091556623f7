"""HTML page of a run: verdict, figures, images, and tables of numbers, settings,
checks, events.
"""

import base64
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cell.perception.length_checks import SOURCES
from cell.record import files
from cell.record.columns import FARTHEST_HAND
from cell.record.events import Outlook
from cell.record.header import Result
from cell.record.listing import read_row
from cell.record.run import Run, read_broken_run
from cell.record.truth import read_truth
from cell.report import figures
from cell.report.html import Link, page
from cell.report.overlay import (
    ShownImages,
    Silhouette,
    close_ups,
    key_pictures,
    poster,
    silhouettes,
    window_on,
)
from cell.report.page_verdict import key_figures, verdict_of
from cell.report.words import (
    MINUS,
    NO_VALUE,
    SIGNAL_UNITS,
    event_sentence,
    event_title,
    millimetres,
    milliseconds,
    seconds,
    value_text,
)
from drivers.base.errors import ConfigurationError, in_percent
from drivers.base.files import write_file
from drivers.strip.effects import registry

FILES = (
    (files.RECORDING, "the fold in Rerun: rerun run.rrd"),
    (files.FILM, "the film of the camera, in step with frames/index.jsonl"),
    (files.OVERLAY, "the film with what was read in it"),
    (
        files.CALIBRATION,
        "the camera's calibration; cell report calibration.yaml draws it",
    ),
    (files.TICKS, "gripper, contact and force over time"),
    (files.PROFILE, "the strip in every image"),
    (files.RUN, "settings and versions"),
)
LARGEST_FILM = 8_000_000  # bytes that a page carries
FREQUENT = 40  # events of one kind, above which they are counted and not listed
LISTED_EVENTS = 400
LEAST_LENGTH = 0.01  # s of a film
# states whose beginning is marked on the film
MARKED_STATES = {"LIFT": "lift", "FOLD": "fold", "RELEASE": "release"}
LONGEST_LIST = 100  # characters of a list
HEIGHT_ON_DESK = 0.01  # m, above which a gripper has lifted the strip
PREFLIGHT = "preflight"
LEFT_OUT = frozenset(
    {"config", "preflight", "schema", "provenance", "spread", "plant_sha256"}
)
SHOWN_ELSEWHERE = frozenset({PREFLIGHT, "origin"})
Rows = list[tuple[str, str]]


def write_report(folder: Path) -> Path:
    """Write the HTML page of the run in `folder` into it, and return the page's path.

    A run that died or is damaged is reported as far as it can be read. Raises
    ConfigurationError for a folder without a readable run.yaml, or one that cannot be
    written.
    """
    return write_page(read_broken_run(folder))


def write_page(run: Run) -> Path:
    """Write the HTML page of the `run` into its folder, and return the page's path."""
    path = run.folder / files.REPORT
    write_file(path, report(run))
    return path


def report(run: Run) -> str:
    """Text of the HTML page of the `run`."""
    header = run.header
    policy = f", policy {header.policy}" if header.policy else ""
    under_way = files.is_under_way(run.folder)
    truth, spoilt = truth_of(run)
    said, numbers = verdict_of(run, under_way), key_figures(run, truth or {})
    died = run.result is None and not under_way and not said.spoilt
    shown, outlook = ShownImages.of(run), Outlook.from_events(run.events())
    outlines = silhouettes(run, shown)
    has_ticks = run.ticks.t.size > 0
    return page(
        "report/templates/run.html",
        f"{header.strip} · {run.name}",
        kicker=f"Fold {read_row(run.folder).short} of {header.strip}{policy}",
        name=run.name,
        said=said,
        close_ups=close_ups(run, shown) if numbers else (),
        spoilt=spoilt,
        advice=advice(run) if died else [],
        measures=measures(run),
        weights=numbers,
        beliefs=beliefs(run, outlook),
        film=film_of(run, shown, outlines),
        checks=checks(run),
        events=_listed_events(run),
        files=[(Link(n, n), what) for n, what in FILES if (run.folder / n).is_file()],
        facts=[(key, setting_text(key, value)) for key, value in stated_settings(run)],
        pictures=key_pictures(run, shown, outlines),
        outlook=figures.outlook_figure(run, outlook) if len(outlook.t) > 1 else "",
        strip=figures.strip_figure(run, outlines) if has_ticks else "",
        signals=figures.signals_figure(run) if has_ticks else "",
    )


def truth_of(run: Run) -> tuple[Mapping[str, Any] | None, list[str]]:
    """Ground truth of a run on the twin, None where unreadable, and texts on all broken
    parts.
    """
    spoilt = list(run.problems)
    try:
        return read_truth(run.folder), spoilt
    except ConfigurationError as error:
        return None, [*spoilt, str(error)]


def film_of(
    run: Run, shown: ShownImages, outlines: Sequence[Silhouette] = ()
) -> dict[str, Any] | None:
    """Film of a run: times [s], source, poster, size, curves; None without a film of
    any image. It plays from the lift on, and opens amid the fold.

    A page with the content can be mailed; a film of more than LARGEST_FILM stays beside
    it.
    """
    path = run.folder / files.FILM
    stamps = list(run.film_stamps().values())
    if not stamps or not path.is_file():
        return None
    source = files.FILM
    if path.stat().st_size <= LARGEST_FILM:
        source = f"data:video/mp4;base64,{base64.b64encode(path.read_bytes()).decode()}"

    begin, end = stamps[0], max(stamps[-1], stamps[0] + LEAST_LENGTH)
    # what came before the lift was not measured
    start = min(max(begin, 0.0), end - LEAST_LENGTH)
    return {
        "begin": begin,
        "source": source,
        "poster": poster(run, shown),
        "start": start - begin,
        "moment": shown.middle[0].stamp - begin,
        "length": end - begin,
        "marks": [
            (100 * (t - start) / (end - start), t, word) for t, word in marks(run)
        ],
        **_cut(run),
        **_measured_curves(run, shown, outlines),
    }


def marks(run: Run) -> list[tuple[float, str]]:
    """Times [s] and names of what happened in a film: states as they begin, the touch
    of the layers, faults.
    """
    touch = None if run.result is None else run.result.t_layer_touch
    begun: dict[str, float] = {}
    # one that another program recorded has no states
    for t, state in zip(run.ticks.t.tolist(), run.ticks.state, strict=False):
        begun.setdefault(state, t)
    found = [(begun[s], word) for s, word in MARKED_STATES.items() if s in begun]

    if touch is not None:
        found.append((touch, "touch"))
    found += [(event.t, "fault") for event in run.events() if event.kind == "fault"]
    at_once = {round(t, 1): (t, word) for t, word in sorted(found)}
    return [*at_once.values()]


def _cut(run: Run) -> dict[str, Any]:
    """Part of a run's film that shows the strip: its `shape`, and how `wide` the whole
    film is and where it begins [%].
    """
    calibration = run.calibration()
    if calibration is None or not run.ticks.t.size:
        return {"shape": "auto", "wide": 100, "left": 0, "top": 0}
    part = window_on(run.ticks, calibration)
    width, height = part.right - part.left, part.bottom - part.top
    return {
        "shape": f"{width} / {height}",
        "wide": round(100 * calibration.lens.width / width, 3),
        "left": round(-100 * part.left / width, 3),
        "top": round(-100 * part.top / height, 3),
    }


def beliefs(run: Run, outlook: Outlook) -> list[tuple[str, str, str]]:
    """Table rows on what a fold showed of the strip: the property's name, the value
    found, and the value that its file states.
    """
    rows = []
    if run.result is not None and (final := run.result.foretold) is not None:
        expected = millimetres(final.displacement, signed=True)
        text = f"{expected} ± {millimetres(final.sigma)}"
        rows.append(("displacement", text, NO_VALUE))
    if not len(outlook.t):
        return rows
    stated = run.header.strip_file or {}
    for name, (label, scale, _) in figures.PANELS.items():
        if name == "displacement":
            continue
        value, low, high = scale * outlook.band(name)[:, -1]
        title, unit = label.rstrip("]").split("  [")
        known = stated.get(name)
        in_file = NO_VALUE if known is None else f"{scale * known:.3g} {unit}"
        rows.append((title, f"{value:.3g} {unit} ({low:.3g} to {high:.3g})", in_file))
    return rows


def _measured_curves(
    run: Run, shown: ShownImages, outlines: Sequence[Silhouette]
) -> dict[str, Any]:
    """Strip profiles for the film, and `outlines` of the strip as it is laid: image
    `size` [px]; `curves`, pairs of time [s], flat pixels.
    """
    calibration = run.calibration()
    if calibration is None:
        return {"size": (), "curves": ()}
    read = [
        (t, calibration.to_image(points[::2]))
        for t, points in run.profile.curves()
        if np.abs(points).max(initial=0.0) < FARTHEST_HAND
    ]
    stamps = {note.sequence: note.stamp for note in shown.laid}
    read += [
        (stamps[each.sequence], np.vstack([each.pixels[::8], each.pixels[:1]]))
        for each in outlines
    ]
    curves = [(round(t, 3), np.rint(px).astype(int).ravel().tolist()) for t, px in read]
    return {"size": calibration.lens.size, "curves": curves}


def measures(run: Run) -> Rows:
    """Table rows (name, text) of a run's main numbers."""
    noticed = next(
        (event.t for event in run.events() if event.kind == "touch_seen"), None
    )
    rows = Rows() if run.result is None else _result_rows(run.result, noticed)
    calibration, error = run.calibration(), "not recorded"
    if calibration is not None:
        error = millimetres(calibration.residual)
    return [*rows, ("error of the calibration", error), *_timing_rows(run)]


def _result_rows(result: Result, noticed: float | None) -> Rows:
    """Table rows (name, text) of a result, whose touch was known when `noticed` [s]."""
    rows = Rows()
    if result.l1 is not None:
        rows.append(("upper layer l1", millimetres(result.l1)))
        rows.append(("lower layer l2", millimetres(result.l2)))
    if result.t_layer_touch is not None:
        later = "" if noticed is None else f", noticed at {seconds(noticed)}"
        rows.append(("layers touched at", f"{seconds(result.t_layer_touch)}{later}"))
    if result.agreement is not None:
        rows.append(("strip beside its model", millimetres(result.agreement.residual)))
    if result.confidence is not None:
        rows.append(("confidence in the touch", in_percent(result.confidence)))
    for note in result.witnesses:
        apart = millimetres(note.difference, signed=True)
        sources = SOURCES.get(note.name, "lengths")
        said = f"{sources} differ: {note.name.replace('_', ' ')}"
        rows.append((said, f"{apart} ± {millimetres(note.spread)}"))
    if result.duration is not None:
        rows.append(("duration", seconds(result.duration, 1)))
    return rows


def stated_settings(run: Run) -> list[tuple[str, Any]]:
    """Pairs (key, value) of the settings in run.yaml: keys joined by dots, no empty
    values.
    """
    content = run.header.model_dump(
        by_alias=True, exclude_none=True, exclude_unset=True
    )
    unlearned = (0, None)  # values of a fold that nothing was corrected in
    return [
        (key, value)
        for key, value in flatten(content)
        if value not in ("", [])
        and not (key.startswith("learning.") and value in unlearned)
    ]


def checks(run: Run) -> list[tuple[str, str, str]]:
    """Table rows (name, result, reason) of the checks before a run's motion."""
    listed = [
        event.facts.get("checks") for event in run.events() if event.kind == PREFLIGHT
    ]
    return [
        _check(item)
        for items in listed
        if isinstance(items, list)
        for item in items
        if isinstance(item, Mapping)
    ]


def _listed_events(run: Run) -> list[tuple[str, str, str]]:
    """Table rows (time, kind, facts) of events; frequent kinds are only counted."""
    events = [event for event in run.events() if event.kind not in SHOWN_ELSEWHERE]
    counts = Counter(event.kind for event in events)
    rare = [event for event in events if counts[event.kind] <= FREQUENT]
    rows = [
        (f"{e.t:.3f}".replace("-", MINUS), event_title(e.kind), event_sentence(e.facts))
        for e in rare[:LISTED_EVENTS]
    ]
    for kind, count in sorted(counts.items()):
        if count > FREQUENT:
            rows.append((NO_VALUE, event_title(kind), f"{count} times"))
    return rows


def advice(run: Run) -> list[str]:
    """Sentences for the operator on what to do after a run whose process died."""
    steps = [
        *_steps_at_the_arm(run),
        "A motion is never resumed: start a new run.",
        (
            "What was measured can be used: the gap workflow reads this folder as far"
            " as it goes."
        ),
    ]
    for fault in [e for e in run.events() if e.kind == "fault"][-1:]:
        text = f"t = {fault.t:.2f} s: {event_sentence(fault.facts)}"
        steps.insert(0, f"The last fault before the end: {text}.")
    return steps


def _steps_at_the_arm(run: Run) -> list[str]:
    """Sentences on what to do with arm and strip after a run whose process died."""
    drivers = run.header.drivers
    if drivers is not None and drivers.arm == "twin":
        return ["Nothing needs to be put right: the twin's arm ended with its process."]
    lifted = run.ticks.t.size > 0 and run.ticks.z[-1] > HEIGHT_ON_DESK
    hand = "Open the fingers with `cell open` and lift the hand with `cell home`."
    return [
        (
            "Make sure that the arm stands still; it brakes by itself when commands"
            " stop coming."
        ),
        *([hand] if lifted else []),
        "Lay the strip flat again.",
    ]


def _check(item: Mapping[str, Any]) -> tuple[str, str, str]:
    """Table row (name, result, reason) of a check before the motion, with a remedy
    where it failed.
    """
    name, reason, remedy = (
        str(item.get(key, "")) for key in ("name", "reason", "remedy")
    )
    if item.get("passed"):
        return name, "pass", reason
    return name, "fail", f"{reason}; {remedy}"


def _timing_rows(run: Run) -> Rows:
    """Table rows on the age of images, and on the longest time between states of a real
    arm.
    """
    rows = Rows()
    ages = figures.image_ages(run)
    timing = run.header.arm_timing
    if ages.size:
        largest = milliseconds(ages.max())
        text = f"{milliseconds(np.median(ages))}, at most {largest}"
        rows.append(("age of the images when used", text))
    if timing is not None:
        longest = f"at most {milliseconds(1e-3 * timing.longest_ms)}"
        rows.append(("from state to state of the arm", longest))
    return rows


def flatten(content: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield nested settings as (key, value) with keys joined by dots, except
    LEFT_OUT.
    """
    for key, value in content.items():
        if key in LEFT_OUT:
            continue
        if isinstance(value, Mapping):
            yield from flatten(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def setting_text(key: str, value: Any) -> str:
    """Text of the setting `key`: known lengths in mm, effects with their unit, long
    lists counted.

    Values of any type have one: run.yaml may be damaged.
    """
    *groups, name = key.split(".")
    match groups:
        case [*_, "effects", effect] if effect in registry() and isinstance(
            value, int | float
        ):
            units = {
                p.name: p.unit for p in registry()[effect].parameters if p.unit != "1"
            }
            return f"{value:g} {units.get(name, '')}".strip()
    if (
        key.startswith("sigma.")
        and name not in SIGNAL_UNITS
        and isinstance(value, float)
    ):
        return millimetres(value)
    if isinstance(value, list | tuple):
        joined = ", ".join(str(item) for item in value)
        return joined if len(joined) <= LONGEST_LIST else f"{len(value)} entries"
    return value_text(name, value)
