"""What a pendulum's model may lack, and what may be wrong in what it has."""

from collections.abc import Callable, Sequence

import numpy as np

from cell.gap.subject.pendulum.chain import fastest
from cell.gap.subject.pendulum.file import PendulumFile
from cell.gap.subject.subject import Candidate, Parameter, Quantity, Scope
from drivers.errors import ConfigurationError
from drivers.types import Array

ANGLE_TOLERANCE = 0.001  # rad, of a hinge and its encoder
NUMBER_SPREADS = (("com", "m", 0.01), ("inertia", "kg m^2", 0.10), ("length", "m", 0.005))
"""Relative spread of what was weighed and measured."""


def scope(pendulum: PendulumFile) -> Scope:
    """Base parameters, candidates and terms of a pendulum; accepted effects are refitted."""
    kept = [c for c in candidates(pendulum) if c.name not in pendulum.effects]
    return Scope(
        base=(*_base(pendulum), *_accepted_parameters(pendulum)),
        candidates=tuple(kept),
        terms=_terms(pendulum),
        quantities={"angle": Quantity("angle_mrad", 1e3, "mrad", ANGLE_TOLERANCE)},
    )


def _base(pendulum: PendulumFile) -> list[Parameter]:
    parameters = []
    for i, (link, unit) in enumerate(zip(pendulum.links, _viscous(pendulum), strict=True)):
        name = f"damping_{i + 1}"
        parameters.append(
            Parameter(name, "N m s", link.damping, 0.0, unit, 1e-5 * unit, 0.1 * unit)
        )
    for key, unit_name, spread in NUMBER_SPREADS:
        for i, link in enumerate(pendulum.links[:-1] if key == "length" else pendulum.links):
            v = getattr(link, key)
            step, width = 1e-3 * spread * v, spread * v
            p = Parameter(f"{key}_{i + 1}", unit_name, v, 0.2 * v, 5.0 * v, step, width)
            parameters.append(p)
    return parameters


def _accepted_parameters(pendulum: PendulumFile) -> list[Parameter]:
    parameters = []
    for candidate in candidates(pendulum):
        values = pendulum.effects.get(candidate.name)
        for p in candidate.parameters if values is not None else ():
            start = float((values or {})[p.name])
            name = f"{candidate.name}.{p.name}"
            parameters.append(Parameter(name, p.unit, start, p.low, p.high, p.step, p.spread))
    return parameters


def _viscous(pendulum: PendulumFile) -> list[float]:
    """Damping of each joint at which its links would hardly swing [N m s]."""
    return [float(w / fastest(pendulum)) for w in pendulum.weights]


def candidates(pendulum: PendulumFile) -> tuple[Candidate, ...]:
    """Every effect of the library that this pendulum can have."""
    weight, n = pendulum.weights, len(pendulum.links)
    rate = fastest(pendulum)
    per_joint: tuple[tuple[str, str, str, str, Array, str], ...] = (
        ("dry_friction", "the hinges rub like dry friction", "torque", "N m", weight,
         "small swings: dry friction ends them, other losses fade"),
        ("quadratic_damping", "the hinges brake with the square of their rate", "coefficient",
         "N m s^2", weight / rate**2, "large swings against small ones"),
        ("wire_spring", "wires or cables pull the hinges back like springs", "stiffness",
         "N m/rad", weight, "a slow swing: its period shortens"),
    )  # fmt: skip
    found = [_joints(*row) for row in per_joint]
    found += [
        _one("air_drag", "the air brakes the links with the square of their speed",
             "coefficient", "kg/m^2", (0.003, 0.02, 0.1), 1.0, "large swings against small ones"),
        _one("frame_tilt", "the frame stands tilted", "angle", "rad",
             (0.002, 0.01), 0.2, "let it hang still and read the angle", signed=True),
        _one("pivot_compliance", "the pivot gives way sideways", "compliance", "m/N",
             (1e-6, 1e-5, 1e-4), 1e-3, "press the frame while it swings"),
    ]  # fmt: skip
    if n > 1:
        found.append(_bias(n))
    return tuple(sorted(found, key=lambda c: c.name))


def _joints(name: str, sentence: str, key: str, unit: str, size: Array, reveal: str) -> Candidate:
    parameters = tuple(
        Parameter(f"{key}_{i + 1}", unit, 0.0, 0.0, 0.5 * s, 1e-5 * s, 0.05 * s)
        for i, s in enumerate(size)
    )
    return Candidate(name, sentence, "strip", parameters, _each(size, (2e-4, 2e-3)), reveal)


Probes = tuple[tuple[tuple[float, ...], ...], ...]


def _each(size: Sequence[float] | Array, factors: Sequence[float]) -> Probes:
    """One parameter at a time, in a group for each factor of its size."""
    eye = np.eye(len(size)) * np.asarray(size)
    return tuple(tuple(tuple(map(float, row * f)) for row in eye) for f in factors)


def _one(
    name: str, sentence: str, key: str, unit: str, probes: Sequence[float], high: float,
    reveal: str, *, signed: bool = False,
) -> Candidate:  # fmt: skip
    small, large = min(map(abs, probes)), max(map(abs, probes))
    p = Parameter(key, unit, 0.0, -high if signed else 0.0, high, 1e-3 * small, 3.0 * large)
    return Candidate(name, sentence, "strip", (p,), tuple(((v,),) for v in probes), reveal)


def _bias(n: int) -> Candidate:
    parameters = tuple(
        Parameter(f"bias_{i + 1}", "rad", 0.0, -0.2, 0.2, 1e-5, 0.03) for i in range(1, n)
    )
    probes = _each([1.0] * (n - 1), (0.002, 0.01))
    return Candidate("encoder_bias", "encoders read a constant too much or too little", "strip",
                     parameters, probes, "let it hang still and read the angles")  # fmt: skip


def _terms(pendulum: PendulumFile) -> tuple[Candidate, ...]:
    """Torques of a joint that describe, and never name, what is left."""
    weight, rate = pendulum.weights, fastest(pendulum)
    made: list[Candidate] = []
    shapes: tuple[tuple[str, str, Callable[[float], float]], ...] = (
        ("constant", "a steady torque", lambda w: w),
        ("cubic", "rate^3", lambda w: w / rate**3),
        ("cubic_spring", "bend^3", lambda w: w),
        ("bent_viscous", "|bend| rate", lambda w: w / rate),
    )
    for name, sentence, size in shapes:
        sizes = [size(float(w)) for w in weight]
        parameters = tuple(
            Parameter(f"torque_{i + 1}", "N m", 0.0, -0.5 * s, 0.5 * s, 1e-5 * s, 0.05 * s)
            for i, s in enumerate(sizes)
        )
        probes = _each(sizes, (2e-4, 2e-3))
        made.append(Candidate(f"term_{name}", sentence, "strip", parameters, probes))
    return tuple(made)


def check_effects(pendulum: PendulumFile, origin: str) -> None:
    """Refuse effects and parameters that the library does not have, and values out of range."""
    known = {c.name: {p.name: p for p in c.parameters} for c in candidates(pendulum)}
    for name, values in pendulum.effects.items():
        if name not in known:
            allowed = ", ".join(known)
            raise ConfigurationError(
                f"{origin}: effects.{name}: unknown effect; allowed: {allowed}"
            )
        if set(values) != set(known[name]):
            raise ConfigurationError(
                f"{origin}: effects.{name}: needs exactly {', '.join(known[name])}"
            )
        for key, value in values.items():
            p = known[name][key]
            if not p.low <= value <= p.high:
                raise ConfigurationError(
                    f"{origin}: effects.{name}.{key}: {value:g} is out of range; "
                    f"allowed: {p.low:g} to {p.high:g} {p.unit}"
                )
