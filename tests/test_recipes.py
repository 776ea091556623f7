"""The recipes of runbooks/architecture.md, each followed once from outside the package."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import cell.exam.causes
import drivers.strip.effects
import policies.catalogue
from cell.config.places import BESIDE, find_configs
from cell.exam.causes import cause_of, causes
from cell.gap.subject.strip.scope import candidate
from cell.orchestrator import monitors
from cell.orchestrator.monitors import Monitor, Rules, check_all
from cell.orchestrator.snapshot import Hold, Snapshot
from cell.orchestrator.states import State
from drivers.errors import Fault
from drivers.protocols import Camera, Clock
from drivers.strip.describe import load_strip
from drivers.strip.effects import registry
from drivers.types import Frame
from policies.catalogue import entries
from policies.registry import make_policy, policy_names
from tests.cell.orchestrator.test_monitors import GOOD
from tests.cell.orchestrator.test_orchestrator_stops import phases
from tests.support.plain_cell import plain_bench

STRIP = """
schema: 1
name: felt
length: 0.5
width: 0.04
areal_density: 0.3
bending_length: 0.025
retardation_time: 0.05
effects: {}
"""

EFFECT = '''
"""A strip that got wet: heavier all along."""

from dataclasses import replace

from drivers.strip.effects.effect import Effect, Parameter, Stage


def _apply(model, values):
    mechanics = model.mechanics
    heavier = mechanics.linear_density * (1.0 + values["share"])
    return replace(model, mechanics=replace(mechanics, linear_density=heavier))


EFFECT = Effect(
    name="wetness",
    sentence="the strip is wet",
    of="strip",
    stage=Stage.LAW,
    parameters=(Parameter("share", "1", low=0.0, high=2.0),),
    apply=_apply,
    revealed_by="a slow fold",
    typical=lambda _: (0.1, 0.5),
)
'''

POLICY = '''
"""`raised`: the triangle, moved up by 60 mm."""

from policies.catalogue.entry import Entry


def _make(_):
    from policies.fixed_paths import Shifted

    return Shifted(rise=0.06)


ENTRY = Entry(rank=50, make=_make)
'''

CAUSE = '''
"""Somebody leans on the desk."""

from typing import ClassVar

from pydantic import Field

from cell.exam.causes.cause import Cause


class Leaning(Cause):
    """The edge is held `sag` [m] lower than the arm believes."""

    amount: ClassVar[str] = "sag"

    sag: float = Field(ge=0, le=0.1)

    def moved(self, pose, time):
        return pose - [0.0, self.sag, 0.0]


CAUSE = Leaning
'''


@pytest.fixture
def beside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder beside the packages; what they found before is forgotten, and again afterwards."""
    scanned = (registry, entries, causes)
    for found in scanned:
        found.cache_clear()
    yield tmp_path
    monkeypatch.undo()
    for found in scanned:
        found.cache_clear()


def only(beside: Path, monkeypatch: pytest.MonkeyPatch, package, name: str, text: str) -> None:
    """A module that one package alone finds."""
    folder = beside / name
    folder.mkdir()
    (folder / f"{name}.py").write_text(text, encoding="utf-8")
    monkeypatch.setattr(package, "__path__", [*package.__path__, str(folder)])


def test_a_strip_is_a_file(tmp_path: Path) -> None:
    (tmp_path / "strips").mkdir()
    (tmp_path / "strips" / "felt.yaml").write_text(STRIP, encoding="utf-8")
    (tmp_path / "cell.yaml").write_bytes((BESIDE / "cell.yaml").read_bytes())
    configs = find_configs(tmp_path)
    assert configs.strip_names() == ("felt",)
    assert configs.strip("felt").length == 0.5


def test_an_effect_is_a_file(beside: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    only(beside, monkeypatch, drivers.strip.effects, "wetness", EFFECT)
    path = beside / "felt.yaml"
    path.write_text(STRIP.replace("effects: {}", "effects: {wetness: {share: 0.5}}"))
    strip = load_strip(path)
    wet = drivers.strip.describe.describe(strip).mechanics.linear_density
    assert np.allclose(wet, 1.5 * strip.linear_density)
    tried = candidate(registry()["wetness"], strip, lifted=0.3)
    assert [float(group[0][0]) for group in tried.probes] == [0.1, 0.5]


def test_a_policy_is_a_file(beside: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    only(beside, monkeypatch, policies.catalogue, "raised", POLICY)
    assert "raised" in policy_names()
    policy = make_policy("raised")
    assert policy.path(0.6).points[:, 1].max() == pytest.approx(0.36)


def test_a_cause_is_a_file(beside: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    only(beside, monkeypatch, cell.exam.causes, "leaning", CAUSE)
    cause = cause_of("leaning", {"sag": 0.01})
    assert cause.moved(np.zeros(3), 0.0) == pytest.approx([0.0, -0.01, 0.0])


def test_a_monitor_is_an_entry_of_the_list(monkeypatch: pytest.MonkeyPatch) -> None:
    def too_high(snapshot: Snapshot, rules: Rules) -> str | None:
        return "the gripper is above 10 cm" if snapshot.arm.pose.z > 0.1 else None

    tall = Monitor("too_high", frozenset({State.FOLD}), too_high)
    monkeypatch.setattr(monitors, "MONITORS", (*monitors.MONITORS, tall))
    settings = find_configs(BESIDE).cell()
    rules = Rules(settings.monitors, settings.installation.workspace)
    with pytest.raises(Fault, match="above 10 cm"):
        check_all(GOOD, Hold(), rules)


class StuckCamera:
    """A camera driver from outside: it delivers one image for ever, with new stamps."""

    rate = 60.0

    def __init__(self, clock: Clock) -> None:
        self._clock = clock

    def connect(self) -> None:
        """Nothing to take hold of."""

    def read(self, after: float, timeout: float) -> Frame | None:
        now = self._clock.now()
        image = np.zeros((2, 2, 3), np.uint8)
        return Frame(now, now, "stuck", round(100 * now), image) if now > after else None

    def close(self) -> None:
        """Nothing to let go of."""


def test_a_driver_is_a_class_behind_a_seam(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = plain_bench()
    camera: Camera = StuckCamera(bench.clock)
    monkeypatch.setattr(bench, "camera", camera)
    monkeypatch.setattr("cell.orchestrator.run.phases_of", lambda _: phases())
    outcome = bench.run()
    assert outcome.name == "image_frozen"
    assert bench.at_rest
