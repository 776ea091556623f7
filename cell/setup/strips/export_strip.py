"""Export of strips to other simulators: a MuJoCo chain, or a rod of Newton."""

import json
from collections.abc import Sequence
from math import pi
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree as Xml

from drivers.base.files import new_folder, replace_file
from drivers.strip.describe import describe
from drivers.strip.effects import registry
from drivers.strip.file import StripFile
from drivers.strip.law import LAW_TERMS
from drivers.twin.chain.lumps import Lumps

Simulator = Literal["mjcf", "newton"]
LINKS = 60
SEGMENTS = 20  # of a rod of Newton, whose solver sweeps from one to the next
# of our formats: of MJCF, and of Newton, where 2 is for add_rod(rod=Rod()) of 1.8
MJCF_VERSION, NEWTON_VERSION = 1, 2
OUT_OF_PLANE = "twist and bending across the strip were not measured"
FRICTION = {"bending_hysteresis"}
ALONG_STRIP = {"pre_curl", "crease", "stiffness_gradient", "seam", "hem_mass"}
POWERS = {"nonlinear_bending", "quadratic_damping"}
EXPRESSED: dict[Simulator, set[str]]
EXPRESSED = {"newton": FRICTION, "mjcf": FRICTION | ALONG_STRIP | POWERS}
"""Effects that each format can express; others are stated in words."""


def export_strips(
    strips: Sequence[StripFile], kind: Simulator, out: Path, besides: Sequence[str] = ()
) -> dict[Path, tuple[str, ...]]:
    """Write `strips` as files for another simulator into the new folder `out`, and
    return what each file cannot express, by its path.

    `mjcf` is a chain along +x, clamped at its fixed edge; `newton` is JSON with
    arguments of `Rod` and `ModelBuilder.add_rod`. Both state format and version. Raises
    ConfigurationError where `out` is there
    already.
    """
    unsaid_of = {}
    with new_folder(out) as folder:
        for strip in strips:
            name = f"{strip.name}.{'xml' if kind == 'mjcf' else 'json'}"
            missing = [
                key
                for key in registry()
                if key in strip.effects.keys() - EXPRESSED[kind]
            ]
            law = (LAW_TERMS[key].sentence for key in strip.law)
            unsaid = (
                OUT_OF_PLANE,
                *(registry()[key].sentence for key in missing),
                *law,
                *besides,
            )
            write = _mjcf if kind == "mjcf" else _newton
            replace_file(folder / name, write(strip, unsaid).encode())
            unsaid_of[out / name] = unsaid
    return unsaid_of


def _mjcf(strip: StripFile, unsaid: tuple[str, ...]) -> str:
    """MJCF text, for MuJoCo, of `strip` as a chain of hinges, with comments that name
    in `unsaid` what this cannot express.

    Friction of yarns and powers of joints need MuJoCo 4.
    """
    root = Xml.Element("mujoco", model=strip.name)
    lumps = Lumps.from_model(describe(strip), LINKS)
    root.append(Xml.Comment(f" folding-cell strip, version {MJCF_VERSION}. "))
    root.append(Xml.Comment(f" Not said: {'; '.join(unsaid)}. "))
    Xml.SubElement(root, "compiler", angle="radian")
    Xml.SubElement(root, "option", integrator="implicit")
    body = Xml.SubElement(root, "worldbody")
    tendons = Xml.SubElement(root, "tendon")

    place = 0.0
    for i, span in enumerate(lumps.spans.tolist()):
        body = Xml.SubElement(body, "body", name=f"link{i}", pos=f"{place} 0 0")
        _add_hinge(body, tendons, lumps, i)
        box = {
            "type": "box",
            "size": f"{span / 2} {strip.width / 2} {strip.thickness / 2}",
        }
        box["mass"] = f"{lumps.mass[i] / lumps.scale}"
        Xml.SubElement(body, "geom", box, pos=f"{span / 2} 0 0", contype="0")
        place = span

    Xml.SubElement(body, "site", name="grasped_edge", pos=f"{place} 0 0")
    Xml.indent(root)
    return Xml.tostring(root, encoding="unicode")


def _add_hinge(body: Xml.Element, tendons: Xml.Element, lumps: Lumps, i: int) -> None:
    """Add the hinge with the number `i` of the chain `lumps` to the element `body`, and
    the friction of its yarns to `tendons`.
    """
    hinges = lumps.hinges
    names = ("stiffness", "cubic", "damping", "quadratic", "presliding")
    law = {name: getattr(hinges, name)[i] / lumps.scale for name in names}
    hinge = {
        "name": f"hinge{i}",
        "axis": "0 -1 0",
        "springref": f"{hinges.rest_angle[i]}",
    }
    hinge["stiffness"] = f"{law['stiffness']} 0 {law['cubic']}"
    Xml.SubElement(body, "joint", hinge, damping=f"{law['damping']} {law['quadratic']}")
    if hinges.slip[i] * law["presliding"] > 0:
        yarn = {"stiffness": f"{law['presliding']}", "springyield": f"{hinges.slip[i]}"}
        yarns = Xml.SubElement(tendons, "fixed", yarn, springlength="0")
        Xml.SubElement(yarns, "joint", joint=f"hinge{i}", coef="1")


def _newton(strip: StripFile, unsaid: tuple[str, ...]) -> str:
    """JSON text for the simulator Newton with the arguments of a rod like `strip`,
    means where a property varies along it; it lists in `unsaid` what it lacks.

    With `builder` a ModelBuilder of Newton 1.8, `builder.add_rod(rod=Rod(**rod),
    cfg=builder.ShapeConfig(**shape), **add_rod)` adds it. The clamp holds the first of
    its segments, which begins half a segment before the fixed edge: the first joint
    bends as the stretch from that edge does. A rod has no friction: `friction` are
    springs beside its joints', which slip.
    """
    model = describe(strip).mechanics
    radius = strip.thickness / 2
    span = model.length / (SEGMENTS - 0.5)
    law = model.law
    stiffness = float(model.rigidity.mean()) / span
    mass = float(model.linear_density.mean()) * span
    content = {
        "format": "folding-cell rod for newton",
        "version": NEWTON_VERSION,
        "strip": strip.name,
        "not_said": unsaid,
        "rod": {
            "radius": radius,
            "points": [[(i - 0.5) * span, 0.0, 0.0] for i in range(SEGMENTS + 1)],
        },
        "add_rod": {
            "label": strip.name,
            "bend_stiffness": stiffness,
            "bend_damping": float(model.viscosity.mean()) / span,
        },
        "shape": {"density": mass / (pi * radius**2 * (span + 4 / 3 * radius))},
        "friction": {
            "stiffness": stiffness * law.stiffness_ratio,
            "yield_angle": span * law.yield_curvature / law.stiffness_ratio,
        },
    }
    return json.dumps(content)
