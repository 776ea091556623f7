"""The recipes of runbooks/architecture.md, each followed once from outside the
package.
"""

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import cell.gap.subject.mechanism.effects
import drivers.strip.effects
from cell.base.campaign.progress import Meter
from cell.base.campaign.run import measure
from cell.base.config.cell import CellFile
from cell.base.config.drivers import all_drivers
from cell.base.config.places import CHECKOUT_CONFIGS, find_configs
from cell.base.config.settings import DriverChoice
from cell.base.devices.devices import Trial
from cell.base.devices.open import check_calibrated, open_cell
from cell.gap.open_subject import open_mechanism
from cell.gap.subject.run_folders import find_runs
from cell.gap.subject.strip.scope import candidate
from cell.interface.cli.options import policy_names as typed_policies
from cell.orchestrator import monitors
from cell.orchestrator.monitors import Monitor, Rules, check_all
from cell.orchestrator.snapshot import Hold, Snapshot
from cell.orchestrator.states import State
from drivers.base.errors import ConfigurationError, Fault
from drivers.base.settings import parse
from drivers.strip.describe import load_strip
from drivers.strip.effects import registry
from policies.registry import entries, make_policy, policy_names
from tests.lab.exam.causes import cause_of, causes
from tests.lab.studies import campaign, catalogue
from tests.lab.studies.table import markdown
from tests.support.mechanisms import PRESCRIBED, make_arm
from tests.support.plain_cell import GOOD

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

MECHANISM_EFFECT = '''
"""A magnet that holds a joint where it is."""

import numpy as np

from cell.gap.subject.mechanism.effect import MechanismEffect, per_joint


def _parameters(mechanism):
    return per_joint(mechanism, "torque", "N m", 0.01 * mechanism.torque)


def law(q, v, load, p, at):
    return -p[at] * np.sin(q)


EFFECT = MechanismEffect(
    name="magnet",
    sentence="a magnet holds a joint",
    parameters=_parameters,
    law=law,
    revealed_by="slow motion",
)
'''

POLICY = '''
"""`raised`: the triangle, moved up by 60 mm."""

from policies.registry import Entry


def _make(_):
    from policies.follower import PathPolicy
    from policies.path import triangular

    return PathPolicy("raised", lambda length: triangular(length, 0.06))


ENTRY = Entry(rank=50, make=_make)
'''

CAUSE = '''
"""Somebody leans on the desk."""

from typing import ClassVar

from pydantic import Field

from tests.lab.exam.causes.cause import Cause


class Leaning(Cause):
    """The edge is held `sag` [m] lower than the arm believes."""

    amount: ClassVar[str] = "sag"

    sag: float = Field(ge=0, le=0.1)

    def moved(self, pose, time):
        return pose - [0.0, self.sag, 0.0]


CAUSE = Leaning
'''


STUDY = '''
"""How often a coin shows heads."""

from tests.lab.studies.study import Quantity, Statistic
from tests.lab.studies.study import Study


def draw(number, rng):
    return {"number": number, "thrown": float(rng.uniform())}


def measure(case):
    return {"heads": case["thrown"] > 0.5}


STUDY = Study(
    name="coins",
    question="How often does a coin show heads?",
    draw=draw,
    measure=measure,
    quantities=(Quantity("heads", Statistic.SHARE, "%", 100.0),),
    usual=100,
    quick=1,
)
'''


class Here:
    """An engine that measures in this process, which alone knows the study."""

    def measure(self, parts, folder):
        return (measure(part, folder) for part in parts)


OF_MECHANISMS = (
    cell.gap.subject.mechanism.effects.library,
    cell.gap.subject.mechanism.effects.registry,
    cell.gap.subject.mechanism.effects.torques,
)


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Where packages of somebody else are installed; what was found before is
    forgotten, and again afterwards.
    """
    scanned = (
        registry,
        entries,
        causes,
        all_drivers,
        catalogue.studies,
        *OF_MECHANISMS,
    )
    for found in scanned:
        found.cache_clear()
    monkeypatch.syspath_prepend(tmp_path)
    yield tmp_path
    monkeypatch.undo()
    for name in [name for name in sys.modules if name.startswith("own_")]:
        del sys.modules[name]
    for found in scanned:
        found.cache_clear()


def only(
    beside: Path, monkeypatch: pytest.MonkeyPatch, package, name: str, text: str
) -> None:
    """A module that one package alone finds."""
    folder = beside / name
    folder.mkdir()
    (folder / f"{name}.py").write_text(text, encoding="utf-8")
    monkeypatch.setattr(package, "__path__", [*package.__path__, str(folder)])


def install(place: Path, kind: str, name: str, text: str, object_name: str) -> None:
    """A package of one module whose entry point names its `object_name`, as pip leaves
    it.
    """
    (place / f"own_{name}.py").write_text(text, encoding="utf-8")
    facts = place / f"own_{name}-1.0.dist-info"
    facts.mkdir()
    (facts / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: own-{name}\nVersion: 1.0\n"
    )
    line = f"[folding_cell.{kind}]\n{name} = own_{name}:{object_name}\n"
    (facts / "entry_points.txt").write_text(line)


def test_a_strip_is_a_file(tmp_path: Path) -> None:
    (tmp_path / "strips").mkdir()
    (tmp_path / "strips" / "felt.yaml").write_text(STRIP, encoding="utf-8")
    (tmp_path / "cell.yaml").write_bytes((CHECKOUT_CONFIGS / "cell.yaml").read_bytes())
    configs = find_configs(tmp_path)
    assert configs.strip_names() == ("felt",)
    assert configs.strip("felt").length == 0.5


def test_an_effect_is_a_package_of_one_file(installed: Path) -> None:
    install(installed, "effects", "wetness", EFFECT, "EFFECT")
    path = installed / "felt.yaml"
    path.write_text(STRIP.replace("effects: {}", "effects: {wetness: {share: 0.5}}"))
    strip = load_strip(path)
    wet = drivers.strip.describe.describe(strip).mechanics.linear_density
    assert np.allclose(wet, 1.5 * strip.linear_density)
    tried = candidate(registry()["wetness"], strip, lifted=0.3)
    assert [float(group[0][0]) for group in tried.probes] == [0.1, 0.5]


def test_an_effect_of_a_mechanism_is_a_package_of_one_file(installed: Path) -> None:
    install(installed, "mechanism_effects", "magnet", MECHANISM_EFFECT, "EFFECT")
    file, runs = make_arm(installed / "arm", 2, content=PRESCRIBED, span=0.5)
    arm = open_mechanism(file, find_runs([runs]))
    magnets = {"magnet": np.array([0.5, 0.0])}
    plain, magnet = arm.simulate(
        [arm.stated(arm.runs[0], effects) for effects in ({}, magnets)]
    )
    assert "magnet" in {c.name for c in arm.scope.candidates}
    assert np.abs(magnet.mean - plain.mean).max() > 0.01


def test_a_policy_is_a_package_of_one_file(installed: Path) -> None:
    install(installed, "policies", "raised", POLICY, "ENTRY")
    assert "raised" in typed_policies()
    assert "raised" in policy_names()
    policy = make_policy("raised")
    assert policy.path(0.6).points[:, 1].max() == pytest.approx(0.36)


def test_a_cause_is_a_package_of_one_file(installed: Path) -> None:
    install(installed, "causes", "leaning", CAUSE, "CAUSE")
    cause = cause_of("leaning", {"sag": 0.01})
    assert cause.moved(np.zeros(3), 0.0) == pytest.approx([0.0, -0.01, 0.0])


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("wet", "EFFECT = 1", "is of int, must be of Effect"),
        ("wet", "import nothing_of_that_name", "cannot be imported: No module named"),
        ("wet", "OTHER = 1", "cannot be imported"),
        (
            "wet",
            "raise ValueError('no water')",
            "cannot be imported: ValueError: no water",
        ),
        ("wet", "import sys; sys.exit(0)", "cannot be imported: SystemExit: 0"),
        ("seam", "EFFECT = 1", "this name is taken"),
    ],
)
def test_a_broken_package_is_named(
    installed: Path, name: str, text: str, said: str
) -> None:
    install(installed, "effects", name, text, "EFFECT")
    with pytest.raises(
        ConfigurationError, match=f"effects: {name} of package own-{name}.*{said}"
    ):
        registry()


@pytest.mark.parametrize("does", ["raise ValueError('no')", "raise SystemExit(0)"])
def test_a_package_whose_policy_cannot_be_made_is_named(
    installed: Path, does: str
) -> None:
    text = "from policies.registry import Entry\n\nENTRY = Entry(9, lambda _: make())\n"
    text += f"\ndef make():\n    {does}\n"
    install(installed, "policies", "sunk", text, "ENTRY")
    with pytest.raises(
        ConfigurationError, match=r"policies: sunk of package own-sunk.*fails"
    ):
        make_policy("sunk")


def test_a_monitor_is_an_entry_of_the_list(monkeypatch: pytest.MonkeyPatch) -> None:
    def too_high(snapshot: Snapshot, rules: Rules) -> str | None:
        return "the gripper is above 10 cm" if snapshot.arm.pose.z > 0.1 else None

    tall = Monitor("too_high", frozenset({State.FOLD}), too_high)
    monkeypatch.setattr(monitors, "MONITORS", (*monitors.MONITORS, tall))
    settings = find_configs(CHECKOUT_CONFIGS).cell()
    rules = Rules(settings.monitors, settings.installation.workspace)
    with pytest.raises(Fault, match="above 10 cm"):
        check_all(GOOD, Hold(), rules)
    assert monitors.is_outcome("too_high")


CAMERA = '''
"""A camera whose images never change."""

from cell.base.config.drivers import Driver
from drivers.base.settings import Settings

class StuckSettings(Settings):
    serial: int

class StuckCamera:
    def __init__(self, settings, clock):
        self.identity = f"stuck {settings.serial}"

DRIVER = Driver("own_stuck:StuckCamera", settings="own_stuck:StuckSettings")
'''


def test_a_driver_is_a_package_of_one_file(installed: Path) -> None:
    install(installed, "cameras", "stuck", CAMERA, "DRIVER")
    configs = find_configs(CHECKOUT_CONFIGS)
    lying, stated = configs.strip("denim"), configs.cell().model_dump(by_alias=True)
    stated["drivers"] = {"camera": "stuck"}
    with pytest.raises(
        ConfigurationError, match=r"arm: must be one of twin, fci \(found 'stuck'"
    ):
        parse({"arm": "stuck"}, DriverChoice, "cell.yaml: drivers")
    cell = parse(stated | {"cameras": {"stuck": {"serial": 5}}}, CellFile, "cell.yaml")
    with pytest.raises(ConfigurationError, match="camera stuck needs one"):
        check_calibrated(cell)
    assert (
        open_cell(cell, lying, Trial(), calibrating=True).camera_identity == "stuck 5"
    )
    with pytest.raises(
        ConfigurationError, match=r"cell.yaml: cameras: stuck: serial: is missing"
    ):
        open_cell(
            parse(stated, CellFile, "cell.yaml"), lying, Trial(), calibrating=True
        )
    with pytest.raises(
        ConfigurationError, match=r"must be one of stuck \(found 'v4l2'"
    ):
        parse(stated | {"cameras": {"v4l2": {}}}, CellFile, "cell.yaml")
    del sys.modules["own_stuck"].StuckSettings
    with pytest.raises(ConfigurationError, match=r"own.stuck.* fails"):
        open_cell(cell, lying, Trial(), calibrating=True)


def test_study_is_one_file(installed: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    only(installed, monkeypatch, catalogue, "coins", STUDY)
    asked = campaign.StudyRequest(catalogue.study_of("coins"), 0, 40, installed / "out")
    campaign.measure(asked, Here(), Meter(), (1, 1), again=False)
    assert "| all | 40 |" in markdown(campaign.read_study(asked))
    sys.modules.pop(f"{catalogue.__name__}.coins")
