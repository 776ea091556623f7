"""Writes an accepted mechanism: effects that MJCF can express to its model, others to
its file.
"""

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from cell.gap.subject.mechanism.effect import Known
from cell.gap.subject.mechanism.effects import library
from cell.gap.subject.mechanism.mechanism_file import ACCEPTED_MODEL
from cell.gap.subject.mechanism.model import Mechanism
from cell.gap.subject.mechanism.read_mechanism import LIMITLESS
from cell.gap.subject.subject import NamedValues, note_of
from drivers.base.types import Array

# names of texts in a model for MuJoCo alone
FORMAT, NOT_SAID = "folding-cell", "folding-cell, not said"
KEPT_OF_ACTUATOR = (
    "name",
    "class",
    "group",
    "joint",
    "jointinparent",
    "tendon",
    "site",
    "refsite",
    "body",
    "ctrlrange",
    "ctrllimited",
    "forcerange",
    "forcelimited",
    "gear",
    "delay",
    "nsample",
    "interp",
    "user",
)
INERTIAL = {
    "pos": "body_ipos",
    "quat": "body_iquat",
    "mass": "body_mass",
    "diaginertia": "body_inertia",
}
"""Fields of a model by attributes of MJCF's `inertial`."""


def accepted_content(
    mechanism: Mechanism, base: Mapping[str, float], effects: NamedValues, source: str
) -> dict[str, Any]:
    """Content of the mechanism's file after an acceptance: it names the accepted model,
    and lists the effects that this model cannot express.

    Provenance keeps the old values.
    """
    content = mechanism.file.model_dump(mode="json", by_alias=True, exclude_none=True)
    known = content["effects"]
    notes = content["provenance"]
    parameters = (b.parameter for b in mechanism.base)
    stated = {p.name: p.start for p in parameters}

    for name, value in base.items():
        old = stated.get(name)
        effect, _, key = name.partition(".")
        if effect in known:
            old = known[effect].get(key)
            known[effect][key] = value
        notes.append(note_of(name, old, source, f", is {value:.9g}"))

    for name, values in effects.items():
        notes.append(note_of(f"effects.{name}", None, source))
        effect_of = library()[name]
        if not effect_of.by_fields(mechanism):
            first, *_ = effect_of.parameters(mechanism)  # a law's one value is `amount`
            known[name] = {
                first.name if key == "amount" else key: v for key, v in values.items()
            }

    file = mechanism.file
    content["model"] = str(Path(file.model).with_name(f"{file.name}{ACCEPTED_MODEL}"))
    return content


def accepted_xml(
    mechanism: Mechanism, edited: Any, remarks: Mapping[str, str] | None = None
) -> str:
    """MJCF text of the model of `mechanism`, in which every field that differs in the
    compiled model `edited` has its new value.

    `remarks` by name become texts of the model, in place of those that it has.
    """
    root = ET.fromstring(mechanism.source.text)  # noqa: S314  checked when it was read
    # else as written
    if root.tag != "mujoco" or mechanism.model.nu > len(root.findall("actuator/*")):
        root = ET.fromstring(mechanism.source.spec().to_xml())  # noqa: S314

    _write_bodies(root, mechanism, edited)
    _write_joints(root, mechanism, edited)
    _write_actuators(root, mechanism, edited)
    _write_options(root, mechanism, edited)
    _write_contacts(root, mechanism, edited)
    for name, words in (remarks or {}).items():
        _write_remark(root, name, words)

    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _text(values: Sequence[float] | Array) -> str:
    """Text of the numbers `values` in full precision, separated by spaces."""
    return " ".join(map(repr, np.ravel(values).tolist()))


def _changed(mechanism: Mechanism, edited: Any, i: int, *names: str) -> str:
    """Text of the numbers of part `i` in the fields `names` of the model `edited`;
    empty where they equal those of the mechanism's model.
    """
    old, new = (
        np.hstack([getattr(m, n)[i] for n in names]) for m in (mechanism.model, edited)
    )
    return "" if np.array_equal(old, new) else _text(new)


def _write_contacts(root: ET.Element, mechanism: Mechanism, edited: Any) -> None:
    """Write friction of contact pairs that differs in the model `edited` into the XML
    below `root`.
    """
    model = mechanism.model
    pairs = np.stack([model.pair_geom1, model.pair_geom2], axis=1).tolist()
    rows = {
        frozenset(model.geom(g).name for g in two): i for i, two in enumerate(pairs)
    }
    for element in root.findall("contact/pair"):
        i = rows[frozenset(element.get(key) for key in ("geom1", "geom2"))]
        if friction := _changed(mechanism, edited, i, "pair_friction"):
            element.set("friction", friction)


def _write_bodies(root: ET.Element, mechanism: Mechanism, edited: Any) -> None:
    """Write positions and inertias of bodies that differ in the model `edited` into the
    XML below `root`.
    """
    for i in range(1, edited.nbody):
        if _changed(mechanism, edited, i, "body_pos"):
            _body(root, mechanism, i).set("pos", _place_in_frame(mechanism, edited, i))
        if not _changed(mechanism, edited, i, *INERTIAL.values()):
            continue

        body = _body(root, mechanism, i)
        for old in body.findall("inertial"):
            body.remove(old)

        numbers = {k: _text(getattr(edited, f)[i]) for k, f in INERTIAL.items()}
        body.insert(0, ET.Element("inertial", numbers))
        for compiler in root.findall("compiler"):
            compiler.attrib.pop("inertiafromgeom", None)


def _body(root: ET.Element, mechanism: Mechanism, i: int) -> ET.Element:
    """XML element below `root` of the body with the number `i`, found by its name or by
    that of its first joint.
    """
    if name := mechanism.model.body(i).name:
        return next(e for e in root.iter("body") if e.get("name") == name)
    joint = mechanism.model.joint(mechanism.model.body_jntadr[i]).name
    return next(
        e
        for e in root.iter("body")
        for j in e.findall("joint")
        if j.get("name") == joint
    )


def _place_in_frame(mechanism: Mechanism, edited: Any, i: int) -> str:
    """Text of the position of the body with the number `i`, in the frame in which its
    XML element states positions.
    """
    written = _body(ET.fromstring(mechanism.source.spec().to_xml()), mechanism, i)  # noqa: S314  with quaternions
    place, own = (
        np.fromstring(written.get(key, of_none), sep=" ")
        for key, of_none in (("pos", "0 0 0"), ("quat", "1 0 0 0"))
    )
    back = np.zeros(4)
    turn = np.zeros(4)
    step = np.zeros(3)
    mujoco.mju_negQuat(back, mechanism.model.body_quat[i])
    mujoco.mju_mulQuat(turn, own, back)
    mujoco.mju_rotVecQuat(step, edited.body_pos[i] - mechanism.model.body_pos[i], turn)
    return _text(place + step)


def _write_joints(root: ET.Element, mechanism: Mechanism, edited: Any) -> None:
    """Write damping, armature, stiffness, friction and rest positions of joints that
    differ in the model `edited` into the XML below `root`.
    """
    radian = any(c.get("angle") == "radian" for c in root.findall("compiler"))
    elements = {e.get("name"): e for e in root.iter("joint") if e.get("name")}
    for i, joint in enumerate(mechanism.joints):
        element = elements[joint.name]
        for key, *names in (
            ("damping", "dof_damping", "dof_dampingpoly"),
            ("armature", "dof_armature"),
            ("stiffness", "jnt_stiffness"),
            ("frictionloss", "dof_frictionloss"),
        ):
            if text := _changed(mechanism, edited, i, *names):
                element.set(key, text)
        if _changed(mechanism, edited, i, "dof_frictionloss"):
            element.set("solimpfriction", _text(edited.dof_solimp[i]))
        if _changed(mechanism, edited, i, "qpos_spring"):
            rest = edited.qpos_spring[i]
            turn = 1.0 if radian or not joint.hinge else 180.0 / math.pi
            element.set("springref", _text([rest * turn]))


def _write_actuators(root: ET.Element, mechanism: Mechanism, edited: Any) -> None:
    """Write gains and force limits of actuators that differ in the model `edited` into
    the XML below `root`.
    """
    every = [e for group in root.findall("actuator") for e in group]
    for i, element in enumerate(every):
        if _changed(mechanism, edited, i, "actuator_gainprm", "actuator_biasprm"):
            element.tag = "general"
            for key in set(element.attrib) - set(KEPT_OF_ACTUATOR):
                del element.attrib[key]
            gain = edited.actuator_gainprm[i, :3]
            bias = edited.actuator_biasprm[i, :3]
            element.attrib |= {"gaintype": "fixed", "gainprm": _text(gain)}
            if bias.any():
                element.attrib |= {"biastype": "affine", "biasprm": _text(bias)}
        limits = edited.actuator_forcerange[i]
        if abs(limits[1]) < LIMITLESS:
            element.attrib |= {"forcerange": _text(limits), "forcelimited": "true"}


def _write_options(root: ET.Element, mechanism: Mechanism, edited: Any) -> None:
    """Write time step, integrator, gravity, density of air, and whether contacts are
    off, into the XML below `root`.
    """
    option = _child(root, "option")
    model = mechanism.model
    new = edited.opt
    option.set("timestep", _text([mechanism.file.step]))
    if model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4:
        option.set("integrator", "RK4")
    option.attrib |= {"gravity": _text(new.gravity), "density": _text([new.density])}
    if model.npair == 0:
        _child(option, "flag").set("contact", "disable")


def _write_remark(root: ET.Element, name: str, words: str) -> None:
    """Write a custom text called `name`, with the content `words`, into the XML below
    `root`, in place of one of the same name.
    """
    if root.find("custom") is None:
        root.insert(0, ET.Element("custom"))
    custom = _child(root, "custom")
    for old in custom.findall(f"text[@name='{name}']"):
        custom.remove(old)
    if words:  # MuJoCo refuses empty ones
        ET.SubElement(custom, "text", name=name, data=words)


def unsaid(mechanism: Mechanism, known: Known) -> Iterator[str]:
    """Yield a text on each of the `known` effects, or part of one, that no field of a
    MuJoCo model can express.
    """
    for effect, values in known:
        if not effect.by_fields(mechanism):
            yield f"{effect.name}: {effect.sentence}"
        elif effect.edited:
            pairs = zip(effect.with_shape(mechanism), values, strict=True)
            for p, value in islice(pairs, effect.edited * len(mechanism.joints), None):
                if value != p.start:
                    yield f"{effect.name}: its {p.name}"


def remark_in(text: str, name: str) -> str:
    """Content of the custom text called `name` in the MJCF `text` of a model; empty
    where there is none.
    """
    found = ET.fromstring(text).find(f"custom/text[@name='{name}']")  # noqa: S314  checked
    return "" if found is None else found.get("data", "")


def _child(parent: ET.Element, tag: str) -> ET.Element:
    """First child element of `parent` with the given `tag`, which is added where there
    is none.
    """
    found = parent.find(tag)
    return ET.SubElement(parent, tag) if found is None else found
