"""Swings that could be measured next."""

from collections.abc import Sequence

import numpy as np

from cell.gap.subject.pendulum.chain import fastest
from cell.gap.subject.pendulum.file import PendulumFile
from cell.gap.subject.pendulum.runs import make_run
from cell.gap.subject.subject import Experiment, Run
from drivers.types import Array

SET_UP = 1.0  # minutes to set the pendulum up and let it go


def experiments(pendulum: PendulumFile, runs: Sequence[Run]) -> list[Experiment]:
    """Releases from rest, each as long as the measured runs unless it says otherwise."""
    n = len(pendulum.links)
    span = float(np.median([run.samples.t[-1] for run in runs])) if runs else 5.0
    sigma = float(np.median([run.samples.reading[0] for run in runs])) if runs else 1e-3
    whole = np.ones(n)
    last = np.zeros(n)
    last[-1] = 1.0
    plans = [
        ("small swing", "let all links go together 6 degrees from hanging", 0.1 * whole, span),
        ("medium swing", "let all links go together 30 degrees from hanging", 0.5 * whole, span),
        ("large swing", "let all links go together 80 degrees from hanging", 1.4 * whole, span),
        ("long small swing", "the same from 6 degrees, three times as long", 0.1 * whole, 3 * span),
        ("hang still", "let it hang still and read the angles", 0.0 * whole, span),
    ]
    if n > 1:
        plans.append(("last link alone", "hold the others straight, lift the last link "
                      "60 degrees, let go", 1.0 * last, span))  # fmt: skip
    return [_planned(pendulum, *plan, sigma) for plan in plans]


def _planned(
    pendulum: PendulumFile, name: str, instruction: str, lift: Array, span: float, sigma: float
) -> Experiment:
    step = min(0.02, 0.05 / fastest(pendulum))
    t = np.arange(0.0, span, step)
    angles = np.repeat((np.pi + lift)[:, None], len(t), axis=1)
    run = make_run(pendulum, name, name, t, angles, sigma, np.zeros_like(angles))
    return Experiment(name, instruction, SET_UP + span / 60.0, run)
