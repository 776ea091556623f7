"""Broken mechanisms and runs: one line with what, where, and what to do."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from drivers.base.errors import ConfigurationError
from tests.support.mechanisms import ARM, FORWARD, PRESCRIBED, make_arm, opened
from tests.support.run_edits import edit_table


def line(
    folder: Path,
    *,
    file: dict[str, Any] | None = None,
    xml: str | None = None,
    columns: Callable[[dict[str, Any]], None] | None = None,
    content: dict[str, Any] = PRESCRIBED,
) -> str:
    """The one line that refuses an arm, with something broken in it."""
    path, runs = make_arm(folder, 2, span=0.5, content=content | (file or {}))
    if xml:
        (folder / "arm.xml").write_text(xml)
    if columns:
        edit_table(runs / "00/signals.parquet", columns)
    with pytest.raises(ConfigurationError) as refused:
        opened(path, runs)
    text = str(refused.value)
    assert "\n" not in text
    return text


def _with(text: str) -> str:
    """The arm with `text` where its worldbody begins."""
    return ARM.replace("<worldbody>", text)


PLUGIN = _with('<extension><plugin plugin="x"/></extension><worldbody>')
OUTSIDE = _with('<asset><mesh file="../../etc/x.stl"/></asset><worldbody>')
MODELS = {
    "not XML": (ARM[:80], "is not valid XML"),
    "does not load": (ARM.replace('mass="1.0"', 'mass="-1.0"'), "does not load"),
    "plugin": (PLUGIN, "plugins run foreign code"),
    "deformable": (
        _with('<worldbody><flexcomp name="cloth" type="grid" count="9 9 1"/>'),
        "'cloth' is deformable; rigid bodies are compared: leave it out",
    ),
    "outside": (OUTSIDE, "lies outside"),
    "texture": (
        _with('<asset><texture type="cube" fileright="../x.png"/></asset><worldbody>'),
        "lies outside",
    ),
    "missing": (
        _with('<asset><mesh file="x.stl"/></asset><worldbody>'),
        "x.stl: there is no such file",
    ),
    "parsed file": (
        _with('<asset><model file="x.xml"/></asset><worldbody>'),
        "<model file>: is not read; write it into the model",
    ),
    "copies": (
        _with(
            '<worldbody><replicate count="20"><replicate'
            ' count="10000"><site/></replicate></replicate>'
        ),
        "makes 200000 copies",
    ),
    "height field": (
        _with(
            '<asset><hfield name="h" nrow="40000" ncol="40000" size="1 1 1 1"/></asset>'
            "<worldbody>"
        ),
        'within 2 GB of memory; largest in it is <hfield name="h" nrow="40000"',
    ),
    "arena": (_with('<size memory="6G"/><worldbody>'), '<size memory="6G">'),
    "reading": (
        _with('<sensor><user name="u" dim="800000000"/></sensor><worldbody>'),
        '<user name="u" dim="800000000">',
    ),
    "postures": (_with('<size nkey="10000"/><worldbody>'), "nkey is 10000; allowed"),
    "entity": ("<!DOCTYPE x [<!ENTITY a 'b'>]>" + ARM, "entities"),
    "free joint": (
        ARM.replace('axis="0 1 0" damping="0.1" armature="0.01"', 'type="ball"'),
        "is free or a ball",
    ),
    "pairs": (
        ARM.replace(
            "<actuator>",
            '<contact><pair geom1="upper" geom2="lower"/></contact><actuator>',
        ),
        "contact pairs: would be left out in mode prescribed",
    ),
    "tendon": (
        ARM.replace(
            "<actuator>",
            '<tendon><fixed name="rope" frictionloss="1"><joint '
            'coef="1" joint="elbow"/></fixed></tendon><actuator>',
        ),
        "tendon rope: its frictionloss",
    ),
    "two motors": (
        ARM.replace("</actuator>", '<motor joint="elbow"/></actuator>'),
        "other motors on joint elbow",
    ),
    "other root": ("<html/>", "give MJCF or URDF"),
}


FILES: dict[str, tuple[dict[str, Any], str]] = {
    "unknown key": ({"colour": 1}, "colour: unknown key"),
    "path": ({"model": "../arm.xml"}, "lies outside"),
    "joint": (
        {"inputs": {**PRESCRIBED["inputs"], "wrist": "position"}},
        "no joint 'wrist'; allowed: shoulder, elbow",
    ),
    "effect": (
        {"effects": {"magic": {"x": 1.0}}},
        "effects.magic: unknown effect; allowed:",
    ),
    "range": ({"effects": {"payload": {"mass": -1.0}}}, "out of range; allowed:"),
    "field": (
        {"uncertain": [{"joint": "*", "field": "mass", "spread": "2%"}]},
        "belongs to a body",
    ),
    "schema": ({"schema": 2}, "this version reads 1"),
    "repeats": (
        {"signals": {"t1": {"actuator": "a1", "is": "torque", "sigma": "repeats"}}},
        "no two runs share a condition",
    ),
}


RUNS: dict[str, tuple[Any, str]] = {
    "degrees": (
        lambda table: table.update(shoulder=20.0 * np.degrees(table["shoulder"])),
        "angles are in rad",
    ),
    "jump": (
        lambda table: table.update(t=table["t"] + 3600.0 * (table["t"] > 0.1)),
        "jumps by",
    ),
    "back": (
        lambda table: table.update(t=table["t"][::-1].copy()),
        "times must increase",
    ),
    "no number": (
        lambda table: table.update(t=np.where(table["t"] > 0.1, np.nan, table["t"])),
        "t: row 20 is not a number",
    ),
    "absent": (lambda table: table.pop("elbow"), "elbow: this column is missing"),
}
BROKEN: dict[str, dict[str, tuple[Any, str]]] = {
    "xml": MODELS,
    "file": FILES,
    "columns": RUNS,
}


@pytest.mark.parametrize(
    ("what", "name"), [(w, n) for w, found in BROKEN.items() for n in found]
)
def test_a_broken_model_file_or_table_is_refused(
    tmp_path: Path, what: str, name: str
) -> None:
    change, words = BROKEN[what][name]
    text = line(tmp_path, **{what: change})
    assert words in text
    assert str(tmp_path) in text


def test_a_torque_that_a_simulation_would_compute_wrongly_is_refused(
    tmp_path: Path,
) -> None:
    servo = '<position name="a2" joint="elbow" kp="30"/>'
    for law in (
        'general dyntype="filter" dynprm="0.1"',
        'general delay="0.02" nsample="4"',
        'muscle lengthrange="0 1"',
    ):
        xml = ARM.replace(servo, f'<{law} name="a2" joint="elbow"/>')
        assert "torque a2_torque of a2: its filter" in line(
            tmp_path, xml=xml, content=FORWARD
        )


def test_a_model_that_explodes_is_refused(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    mujoco.set_mju_user_warning(None)
    text = line(tmp_path, xml=ARM.replace('kp="30"', 'kp="3e9"'), content=FORWARD)
    assert "explodes; make step smaller" in text
    assert not (tmp_path / "MUJOCO_LOG.TXT").exists()
