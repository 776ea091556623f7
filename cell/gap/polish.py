"""Fits finished where it counts: to the end, and against the finest simulation of themselves."""

from cell.gap.batch import Simulate, alone
from cell.gap.model import Evidence, Model, Point, evidence, requests
from cell.gap.refit import Estimate, refit
from cell.gap.subject import Subject


def finished(subject: Subject, simulate: Simulate, rough: Estimate) -> Estimate:
    """The fit on runs that are corrected for the grain of simulation at its own values, with the
    scales of the rough one: all models are judged by the same.
    """
    runs = refined(subject, rough.model, rough.point, rough.evidence).runs
    return alone(simulate, refit(rough.model, Evidence(runs, rough.evidence.scales), rough.point))


def founded(subject: Subject, simulate: Simulate, rough: Estimate) -> Estimate:
    """The same with the scales that the grain at these values leaves: for the base."""
    runs = refined(subject, rough.model, rough.point, rough.evidence)
    return alone(simulate, refit(rough.model, runs, rough.point))


def refined(subject: Subject, model: Model, point: Point, known: Evidence) -> Evidence:
    """The runs corrected for the grain of simulation at `point`, whitened by what that leaves."""
    return evidence(subject.refined(requests(model, known.runs, point)))
