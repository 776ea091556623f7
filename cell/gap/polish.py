"""Fits finished where it counts: to the end, and against the finest simulation of themselves."""

from cell.gap.batch import Simulate, alone
from cell.gap.model import Evidence, Model, Point, requests
from cell.gap.refit import Estimate, refit
from cell.gap.subject import Subject


def finished(subject: Subject, simulate: Simulate, rough: Estimate) -> Estimate:
    """The fit on runs that are corrected for the grain of simulation at its own values."""
    runs = refined(subject, rough.model, rough.point, rough.evidence)
    return alone(simulate, refit(rough.model, runs, rough.point))


def refined(subject: Subject, model: Model, point: Point, evidence: Evidence) -> Evidence:
    """The same runs with the same scales, corrected for the grain of simulation at `point`."""
    runs = subject.refined(requests(model, evidence.runs, point))
    return Evidence(tuple(runs), evidence.scales)
