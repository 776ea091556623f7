"""Finds the initial state of a run, as measured or as its mechanism's file states it."""

import numpy as np

from cell.gap.subject.mechanism.load import Opened
from cell.gap.subject.mechanism.runs import Recording
from cell.gap.subject.subject import Parameter
from drivers.types import Array

LEAST = 8  # readings of which the rate at the start is taken


def start_of(opened: Opened, recording: Recording) -> tuple[Array, Array]:
    """Positions [rad or m] and rates (joints,) of the joints at the start of a recording."""
    spec, n = opened.file.start, len(opened.mechanism.joints)
    at = [k for k, s in enumerate(opened.signals) if s.kind == "position"]
    inverse = np.linalg.pinv(opened.mix[at]) if at else np.zeros((n, 0))
    near = max(LEAST, int(np.searchsorted(recording.t, 0.5 / opened.pace)))
    places, slopes = [], []
    for k in at:
        x = recording.columns[opened.signals[k].name][:near]
        known = np.isfinite(x)
        fitted = np.polynomial.Polynomial.fit(recording.t[:near][known], x[known], 3)
        places.append(float(x[known][0]))
        slopes.append(float(fitted.deriv()(0.0)))
    rates = slopes if recording.rates is None else recording.rates
    q = inverse @ places if spec.position == "measured" else np.full(n, spec.position)
    v = inverse @ rates if spec.velocity == "measured" else np.full(n, spec.velocity)
    return q, v


def initial_state(opened: Opened, start: tuple[Array, Array]) -> tuple[Parameter, ...]:
    """Unknown positions and rates (joints,) about a `start`; none if it is exact or settles."""
    spec, pace = opened.file.start, opened.pace
    if spec.spread == 0.0 or spec.settle:
        return ()
    wide = np.inf if spec.spread is None else spec.spread
    rows = (("angle", start[0], "rad", 1.0), ("rate", start[1], "rad/s", pace))
    return tuple(
        Parameter(f"{name}_{joint.name}", unit, float(value), -np.inf, np.inf, step=1e-5 * times,
                  spread=wide * times)
        for name, values, unit, times in rows
        for joint, value in zip(opened.mechanism.joints, values, strict=True)
    )  # fmt: skip
