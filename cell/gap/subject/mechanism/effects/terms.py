"""Generic joint torques that describe unexplained residuals and are never named as causes."""

from collections.abc import Callable
from typing import Any

from cell.gap.subject.mechanism.effect import MODES, Effect, per_joint
from cell.gap.subject.mechanism.effects.drives import bias_law
from cell.gap.subject.mechanism.model import Mechanism
from drivers.types import Array


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
    """Term of one parameter per joint, of a hundredth of `size` in typical torque."""
    return Effect(f"term_{name}", sentence, "model", "a description",
                  lambda m: per_joint(m, "torque", "N m", 0.01 * size(m), signed=True), "",
                  keys=1, law=law, modes=modes)  # fmt: skip


EFFECTS = (
    _term("constant", "a steady torque", bias_law, lambda m: m.torque, MODES),
    _term("cubic", "rate^3", _cubic, lambda m: m.torque / m.rate**3, MODES),
    _term("cubic_spring", "angle^3", _cubic_spring, lambda m: m.torque, MODES),
    _term("bent_viscous", "|angle| rate", _bent_viscous, lambda m: m.torque / m.rate, MODES),
    _term("load_dry", "|load| sign(rate)", _load_dry, lambda m: m.torque / m.torque,
          ("prescribed",)),
)  # fmt: skip
