"""Export of a strip as a MuJoCo chain or as the parameters of a Newton rod."""

import json
from collections.abc import Sequence
from math import pi
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree as Xml

import numpy as np

from drivers.files import new_folder, replace_file
from drivers.strip.describe import describe
from drivers.strip.effects import registry
from drivers.strip.file import StripFile
from drivers.strip.law import LAW_TERMS
from drivers.strip.model import Mechanics
from drivers.types import Array

Simulator = Literal["mjcf", "newton"]
LINKS = 60
PLANE = "twist and bending across the strip were not measured"
PLAIN = {"bending_hysteresis"}
ALONG = {"pre_curl", "crease", "stiffness_gradient", "seam", "hem_mass"}
POWERS = {"nonlinear_bending", "quadratic_damping"}
SAID: dict[Simulator, set[str]] = {"newton": PLAIN, "mjcf": PLAIN | ALONG | POWERS}
"""Effects that a format can say; others are told in words."""


def export_strips(
    strips: Sequence[StripFile], kind: Simulator, out: Path
) -> dict[Path, tuple[str, ...]]:
    """Write `strips` into the new folder `out`; returns what each file cannot say, in words.

    `mjcf` is a chain along +x, clamped at its fixed edge; `newton` is JSON with arguments of
    `ModelBuilder.add_rod`. Raises ConfigurationError where `out` is there already.
    """
    found = {}
    with new_folder(out) as made:
        for strip in strips:
            name = f"{strip.name}.{'xml' if kind == 'mjcf' else 'json'}"
            missing = [key for key in registry() if key in strip.effects.keys() - SAID[kind]]
            law = (LAW_TERMS[key].sentence for key in strip.law)
            unsaid = (PLANE, *(registry()[key].sentence for key in missing), *law)
            model = describe(strip).mechanics
            write = _mjcf if kind == "mjcf" else _newton
            replace_file(made / name, write(strip.name, model, unsaid).encode())
            found[out / name] = unsaid
    return found


def _lump(strip: Mechanics) -> dict[str, Array]:
    """Coefficients (n,) of n equal links, and of the hinge before each.

    Of the links `mass` [kg]; of the hinges `stiffness` [N m/rad], with `cubic` [N m/rad^3];
    `damping` [N m s/rad], with `quadratic` [N m s^2/rad^2]; `rest` [rad]; `friction` [N m/rad] of a
    spring beside the elastic one, which slips at `slip` [rad].
    """
    nodes, law = np.linspace(0.0, strip.length, LINKS + 1), strip.law
    middles = np.concatenate([[0.0], 0.5 * (nodes[:-1] + nodes[1:])])
    reach = np.diff(middles)
    stiffness = strip.series(strip.rigidity, middles) / reach
    return {
        "mass": strip.total(strip.linear_density, nodes),
        "stiffness": stiffness,
        "cubic": stiffness * law.cubic / reach**2,
        "damping": stiffness**2 * strip.total(strip.viscosity / strip.rigidity**2, middles),
        "quadratic": stiffness * law.quadratic_damping / reach,
        "rest": strip.total(strip.rest_curvature, middles),
        "friction": stiffness * law.stiffness_ratio,
        "slip": reach * law.yield_curvature / law.stiffness_ratio,
    }


def _mjcf(name: str, model: Mechanics, unsaid: tuple[str, ...]) -> str:
    """Text of an MJCF file, whose yarns' friction and powers of joints need MuJoCo 4."""
    root, lumps, span = Xml.Element("mujoco", model=name), _lump(model), model.length / LINKS
    root.append(Xml.Comment(f" Not said: {'; '.join(unsaid)}. "))
    Xml.SubElement(root, "compiler", angle="radian")
    Xml.SubElement(root, "option", integrator="implicit")
    body, tendons = Xml.SubElement(root, "worldbody"), Xml.SubElement(root, "tendon")
    box = {"type": "box", "size": f"{span / 2} {model.width / 2} {model.thickness / 2}"}
    for i in range(LINKS):
        of = {name: values[i] for name, values in lumps.items()}
        body = Xml.SubElement(body, "body", name=f"link{i}", pos=f"{span if i else 0} 0 0")
        hinge = {"name": f"hinge{i}", "axis": "0 -1 0", "springref": f"{of['rest']}"}
        hinge["stiffness"] = f"{of['stiffness']} 0 {of['cubic']}"
        Xml.SubElement(body, "joint", hinge, damping=f"{of['damping']} {of['quadratic']}")
        Xml.SubElement(body, "geom", box, mass=f"{of['mass']}", pos=f"{span / 2} 0 0", contype="0")
        if of["slip"] > 0:
            yarn = {"stiffness": f"{of['friction']}", "springyield": f"{of['slip']}"}
            yarns = Xml.SubElement(tendons, "fixed", yarn, springlength="0")
            Xml.SubElement(yarns, "joint", joint=f"hinge{i}", coef="1")
    Xml.SubElement(body, "site", name="grasped_edge", pos=f"{span} 0 0")
    Xml.indent(root)
    return Xml.tostring(root, encoding="unicode")


def _newton(name: str, model: Mechanics, unsaid: tuple[str, ...]) -> str:
    """Text of a JSON file: arguments of a rod, means where they differ along the strip.

    A rod has no friction: `friction` are springs beside its joints', which slip.
    """
    span, radius = model.length / LINKS, model.thickness / 2
    mean = {name: float(values[1:].mean()) for name, values in _lump(model).items()}
    content = {
        "strip": name,
        "not_said": unsaid,
        "add_rod": {
            "radius": radius,
            "bend_stiffness": mean["stiffness"],
            "bend_damping": mean["damping"],
            "positions": [[i * span, 0.0, 0.0] for i in range(LINKS + 1)],
        },
        "shape": {"density": mean["mass"] / (pi * radius**2 * (span + 4 / 3 * radius))},
        "friction": {"stiffness": mean["friction"], "yield_angle": mean["slip"]},
    }
    return json.dumps(content)
