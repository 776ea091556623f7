"""Revision of the base by the models that lead it, and of these beside the revised base."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import takewhile

from cell.gap.fitting.crossvalidation import Validated, validate
from cell.gap.fitting.gauss_newton import ROUGH_GAIN, Estimate, refit
from cell.gap.fitting.model import Evidence, Point
from cell.gap.fitting.scatter import clearly_differ, estimate_spreads, with_scatter
from cell.gap.fitting.spreads import Spread
from cell.gap.fitting.starts import best, objective_of
from cell.gap.fitting.tasks import Simulate, run_all, run_one
from cell.gap.selection.fits import Fits
from cell.gap.selection.likelihood import ALPHA, MIN_GAIN, margin
from cell.gap.selection.posterior import posterior
from cell.gap.selection.refinement import other_signs
from cell.gap.selection.search import BUDGET
from drivers.types import Array


def revised_base(
    simulate: Simulate, fits: Fits, scatter: Sequence[Spread], whole: Evidence
) -> tuple[Estimate, tuple[Spread, ...]] | None:
    """Base and spreads in runs `whole` by leading models; None where neither clearly changes.

    A base that lacks an effect takes a part of it for scatter, or does not see the scatter for it,
    and may have stopped in a local minimum.
    """
    leading = leading_models(fits)
    if not leading:
        return None
    found = estimate_spreads(simulate, leading[0].estimate, whole)
    better = better_base(simulate, fits, leading)
    before = {s.name: s.value for s in scatter}
    if better is None and not clearly_differ(before, {s.name: s.value for s in found}):
        return None
    return with_scatter(better or fits.base.estimate, found, whole), found


def leading_models(fits: Fits) -> list[Validated]:
    """Models that lead the base: the one that predicts clearly better, and more probable ones."""
    by = fits.scale
    names = [fits.best.model.names] if margin(fits.best, fits.base, by).gain >= MIN_GAIN else []
    before_base = takewhile(lambda m: m.names, posterior(fits, by).models)
    names += [m.names for m in before_base if m.p > ALPHA]
    return [m for name in dict.fromkeys(names) if (m := fits.of(name)) is not None]


def better_base(simulate: Simulate, fits: Fits, leading: Sequence[Validated]) -> Estimate | None:
    """Refit the base from its values in `leading` models; None where that is not clearly better.

    A base that stopped in a local minimum leaves a gap that is none.
    """
    base, begin = fits.base.estimate, []
    for fit in (m.estimate for m in leading):
        values, _ = fit.model.split(fit.shared)
        start = Point(values, fit.point.local)
        begin.append(refit(base.model, base.evidence, start, None, ROUGH_GAIN, BUDGET.short_steps))
    begun = best([base, *run_all(simulate, begin)])
    if begun is base:
        return None
    again = run_one(simulate, refit(base.model, base.evidence, begun.point, begun.jacobians))
    scale = min(base.scale, again.scale)
    return again if objective_of(again, scale) < objective_of(base, scale) - MIN_GAIN else None


def refit_on_base(
    simulate: Simulate, fits: Fits, base: Validated, found: Sequence[Spread], whole: Evidence
) -> Fits:
    """Refit the models of `fits` beside a new `base`, with the scatter `found` in runs `whole`.

    Single effects and the best pairs with either sign again: beside another base the other one may
    fit better.
    """
    known, tasks = base.estimate.evidence, []
    for fit in (m.estimate for m in fits.models if m.model.effects):
        start = with_scatter(fit, found, whole).point
        tasks.append(refit(fit.model, known, start, _secants(fit, known), ROUGH_GAIN))
    done = run_all(simulate, [validate(e) for e in run_all(simulate, tasks)])
    fits = replace(fits, models=(base, *done))
    placed = [*fits.of_size(1), *fits.worth(2)[: BUDGET.pairs]]
    return fits.merge(other_signs(simulate, fits, placed))


def _secants(fit: Estimate, known: Evidence) -> tuple[Array, ...] | None:
    """Secants (n, shared + local) of each run at `fit`, whitened by the scales of `known`.

    None where the runs of `known` have other unknowns of their own.
    """
    pairs = list(zip(fit.evidence.runs, known.runs, strict=True))
    if any([p.name for p in a.local] != [p.name for p in b.local] for a, b in pairs):
        return None
    rows = zip(fit.jacobians, fit.evidence.scales, known.scales, strict=True)
    return tuple(jacobian * (had / has)[:, None] for jacobian, had, has in rows)
