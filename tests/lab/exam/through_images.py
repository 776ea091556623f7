"""Runs of the image-based tier: the cell folds a hidden plant through rendered
images.
"""

import shutil
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2

from calibration.calibration import Calibration
from cell.base.config.cell import CellFile
from cell.base.config.places import find_configs
from cell.base.devices.devices import Devices, Trial
from cell.base.devices.open import check_drivers
from cell.base.devices.rig_correction import corrected_devices
from cell.base.devices.twin import twin_devices
from cell.folding.fold import fold
from cell.folding.request import RecordingOptions, Request, standard_requests
from cell.folding.result import FoldResult
from cell.orchestrator.outcome import INTERRUPTED
from cell.orchestrator.snapshot import Snapshot
from cell.orchestrator.states import State
from cell.record.documents import write_document
from cell.record.files import PROFILE, RESULT, RUN, TICKS
from cell.setup.calibration_in_use import calibration_of
from drivers.base.errors import Fault
from drivers.base.readers import read_yaml
from drivers.strip.file import StripFile
from drivers.twin.open import PlantOptions
from policies.registry import BY_HAND, MOTION
from tests.lab.exam.case import Case
from tests.lab.exam.causes import cause_of
from tests.lab.exam.causes.cause import Cause
from tests.lab.exam.from_state import LaggedView, Specimen, scale_strip

LINKS = 200
# s; against 2 ms it moves d by 0.07 mm and contact_x by 0.13 mm rms at most
STEP = 0.004
MOTION_STEPS: Mapping[str, float] = {"shake": 0.001}
"""s, of motions that need a finer one: the least damped knit leaves the model 2.3 times
the noise of its profile with 1 ms, 1.9 with 0.5 ms, 4 with 2 ms and 10 with 4 ms.
"""
FILES = (RUN, TICKS, PROFILE, RESULT)
REFUSED_OUTCOME = "preflight_refused"
HEADER_KEYS = frozenset(
    {"schema", "strip", "sigma", "start", "index", "condition", "speed", "camera_hz"}
    | {"contact_height", "policy", "calibration"}
)
"""Keys of run.yaml that a sealed run keeps: what a diagnosis needs, and nothing of the
plant.
"""
RESULT_KEYS = frozenset(
    {"schema", "outcome", "t_layer_touch", "displacement", "l1", "l2"}
)
"""Keys of result.yaml that a sealed run keeps."""


def make_runs(case: Case, folder: Path, number: int | None = None) -> None:
    """Fold the standard runs of `case`, or the first `number`, into folders NN-NAME of
    `folder`.

    Each holds the four files of a measured run and nothing that gives the plant away.
    Raises ConfigurationError for a case that cannot be folded, Fault for a run that was
    refused or left no record.
    """
    causes = [cause_of(name, values) for name, values in case.causes.items()]
    calibration = calibration_of(find_configs(None).cell())
    for name, request in _requests(case)[:number]:
        with TemporaryDirectory(prefix="exam-") as place:
            placed = _with_plant(case, request, Path(place))
            result = _fold(placed, causes, case, calibration, State.LAY)
            if result.outcome == REFUSED_OUTCOME:
                raise Fault(
                    REFUSED_OUTCOME, f"{placed.policy} of {case.strip}: {result.reason}"
                )
            _copy_sealed(Path(result.run), folder / name, request.strip)


def refusal(case: Case) -> str | None:
    """Reason why the cell's preflight refuses to fold the case's plant; None if it does
    not.

    It does for a desk a few millimetres too high or an edge far from where the strip
    file puts it.
    """
    causes = [cause_of(n, v) for n, v in case.causes.items()]
    _, request = _requests(case)[0]
    calibration = calibration_of(request.cell)
    with TemporaryDirectory(prefix="exam-") as place:
        placed = _with_plant(case, request, Path(place))
        result = _fold(placed, causes, case, calibration, State.GRASP)
    return result.reason if result.outcome == REFUSED_OUTCOME else None


def _requests(case: Case) -> list[tuple[str, Request]]:
    configs, record = find_configs(None), RecordingOptions("none", truth=False)
    known = configs.cell(), configs.strip(case.strip), "", Path(), Trial(seed=case.seed)
    base = Request(*known, record=record)
    requests = standard_requests(base)
    if case.motions == "by_hand":
        led = f"{MOTION}{BY_HAND}{case.seed}"
        requests = tuple(
            replace(r, policy=f"{led}-{i}", speed=None) for i, r in enumerate(requests)
        )
    return [
        (f"{i:02d}-{_motion_name(request)}", request)
        for i, request in enumerate(requests)
    ]


def _motion_name(request: Request) -> str:
    """Name of a fold's motion, for the name of its folder."""
    name = request.policy.removeprefix(MOTION)
    return BY_HAND.rstrip("-") if name.startswith(BY_HAND) else name


def _with_plant(case: Case, request: Request, runs: Path) -> Request:
    """The `request` with the cell and the plant of `case`, recorded in `runs`."""
    settings = exam_cell(request.cell, _motion_name(request))
    trial = replace(request.trial, plant=plant_of(case, request.strip))
    return replace(request, cell=settings, trial=trial, runs=runs)


def exam_cell(settings: CellFile, motion: str) -> CellFile:
    """Cell settings with a plant that is simulated on a finer grid than any model of
    it.
    """
    changes = {"links": LINKS, "step": MOTION_STEPS.get(motion, STEP)}
    world = settings.twin.world.model_copy(update=changes)
    twin = settings.twin.model_copy(update={"world": world})
    return settings.model_copy(update={"twin": twin})


def plant_of(case: Case, strip: StripFile) -> StripFile:
    """True strip of `case`: the strip file with scaled base parameters and hidden
    effects.
    """
    scaled = scale_strip(strip, case.stiffness, case.damping)
    return scaled.model_copy(update={"effects": case.effects, "provenance": ()})


def exam_devices(request: Request, causes: list[Cause], case: Case) -> Devices:
    """Devices of a twin whose plant has the hidden `causes` and the scatter of `case`,
    from whose seed all chance comes.
    """
    settings, strip = request.settings, request.strip
    check_drivers(settings)
    cv2.setNumThreads(1)
    staging = PlantOptions(
        engine=lambda links: Specimen(links, causes, case.seed, case.scatter),
        view=lambda world: LaggedView(world.scene, causes),
    )
    devices = twin_devices(
        settings, strip, request.trial, calibrating=False, staging=staging
    )
    return corrected_devices(devices, settings, strip)


class Until:
    """Observer that interrupts a run as it enters a given state."""

    def __init__(self, state: State) -> None:
        self._state, self._reached = state, False

    def handle_tick(self, snapshot: Snapshot) -> None:
        """Ignore a tick."""

    def handle_event(self, time: float, kind: str, facts: dict[str, object]) -> None:
        """Remember whether an event says that the run enters the final state."""
        self._reached = self._reached or (
            kind == "state" and facts.get("state") is self._state
        )

    def __call__(self) -> bool:
        """Whether the run has entered the final state and may end."""
        return self._reached


def _fold(
    request: Request,
    causes: list[Cause],
    case: Case,
    calibration: Calibration,
    end: State,
) -> FoldResult:
    """Fold the strip of `case` and interrupt the run where it enters the state
    `end`.
    """
    until, devices = Until(end), exam_devices(request, causes, case)
    return fold(request, calibration, (until,), until, devices=devices)


def _copy_sealed(made: Path, final: Path, strip: StripFile) -> None:
    """Copy a record's four files without traces of the plant to `final`."""
    lacking = [name for name in FILES if not (made / name).is_file()]
    if lacking:
        raise Fault(
            "record", f"{final}: the fold of {strip.name} left no {', '.join(lacking)}"
        )
    final.mkdir(parents=True)
    for name in (TICKS, PROFILE):
        shutil.copy(made / name, final / name)
    header, result = read_yaml(made / RUN), read_yaml(made / RESULT)
    write_document(final / RUN, _sealed_header(header))
    write_document(final / RESULT, sealed_result(result))


def _sealed_header(header: Mapping[str, Any]) -> dict[str, Any]:
    """Content of run.yaml without keys that reveal the plant; motions by hand keep a
    number.
    """
    kept = {k: v for k, v in header.items() if k in HEADER_KEYS}
    if BY_HAND in str(kept.get("policy")):
        kept |= dict.fromkeys(
            ("policy", "condition"), f"{BY_HAND}{1 + int(kept['index'])}"
        )
    return kept


def sealed_result(result: Mapping[str, Any]) -> dict[str, Any]:
    """Content of result.yaml for a run that the exam interrupted after its touch was
    measured.
    """
    kept = {k: v for k, v in result.items() if k in RESULT_KEYS}
    touched = all(
        kept.get(k) is not None for k in ("t_layer_touch", "displacement", "l1", "l2")
    )
    if kept.get("outcome") == INTERRUPTED.name and touched:
        kept["outcome"] = "layer_touch"
    return kept
