"""Generic torques that describe the unexplained rest of a mechanism, and are never named."""

from collections.abc import Callable
from typing import Any

from cell.gap.subject.mechanism.effect import MODES, Effect, per_joint
from cell.gap.subject.mechanism.model import Mechanism
from cell.gap.subject.subject import Parameter
from drivers.types import Array


def _constant(q: Array, v: Array, load: Array, p: Array, at: int) -> Any:
    return p[at] + 0.0 * q


def _cubic(q: Array, v: Array, load: Array, p: Array, at: int) -> Any:
    return -p[at] * v**3


def _cubic_spring(q: Array, v: Array, load: Array, p: Array, at: int) -> Any:
    return -p[at] * q**3


def _bent_viscous(q: Array, v: Array, load: Array, p: Array, at: int) -> Any:
    return -p[at] * abs(q) * v


def _load_dry(q: Array, v: Array, load: Array, p: Array, at: int) -> Any:
    return -p[at] * abs(load) * v / (abs(v) + p[3])


def _term(name: str, sentence: str, law: Callable[..., Array],
          size: Callable[[Mechanism], Array], modes: tuple[str, ...]) -> Effect:  # fmt: skip
    def parameters(mechanism: Mechanism) -> tuple[Parameter, ...]:
        return per_joint(mechanism, "torque", "N m", 0.01 * size(mechanism), signed=True)

    return Effect(f"term_{name}", sentence, "model", "a description", parameters, "",
                  keys=1, law=law, modes=modes)  # fmt: skip


TERMS = (
    _term("constant", "a steady torque", _constant, lambda m: m.torque, MODES),
    _term("cubic", "rate^3", _cubic, lambda m: m.torque / m.rate**3, MODES),
    _term("cubic_spring", "angle^3", _cubic_spring, lambda m: m.torque, MODES),
    _term("bent_viscous", "|angle| rate", _bent_viscous, lambda m: m.torque / m.rate, MODES),
    _term("load_dry", "|load| sign(rate)", _load_dry, lambda m: m.torque / m.torque,
          ("prescribed",)),
)  # fmt: skip
