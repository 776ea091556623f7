"""Specification of a benchmark, and its results as stored in benchmark.json."""

from collections.abc import Sequence
from typing import Annotated, Literal, Self, TypeVar

import numpy as np
from pydantic import Field

from cell.base.config.places import Configs
from cell.studies.evaluation import EngineName
from drivers.base.errors import check_known
from drivers.base.settings import Settings, VersionedFile
from drivers.base.types import Array
from policies.registry import policy_names

FAVOURITE = "denim"
QUICK_FABRICS = ("blanket", "denim", "rib-knit")  # stiff, middling, soft and slow


class Size(Settings):
    """Sizes of simulations: sides of the strip `grid` in the rod and the `chain`,
    `hidden` folds.

    The last is the number of strips on which each effect is hidden.
    """

    grid: int = Field(12, ge=2)
    chain: int = Field(5, ge=2)
    hidden: int = Field(24, ge=2)


QUICK = Size(grid=4, chain=2, hidden=4)


class BenchmarkSpec(Settings):
    """Scope of a benchmark: policies and strips by name, `repeats` of one strip, seed
    and size.
    """

    policies: tuple[str, ...]
    strips: tuple[str, ...]
    repeats: int = Field(5, ge=1)
    seed: int = Field(0, ge=0)
    extent: Size = Size()

    @classmethod
    def build(
        cls,
        configs: Configs,
        policies: tuple[str, ...],
        strips: tuple[str, ...],
        repeats: int | None,
        seed: int,
        *,
        quick: bool,
    ) -> Self:
        """Specification by options of the command line; no names stand for all known
        ones.

        Raises ConfigurationError for an unknown name.
        """
        known = configs.strip_names()
        usual = (
            tuple(name for name in QUICK_FABRICS if name in known) if quick else known
        )
        return cls(
            policies=_check_names(
                policies or policy_names(), policy_names(), "policies"
            ),
            strips=_check_names(strips or usual or known, known, "strips"),
            repeats=repeats or (2 if quick else 5),
            seed=seed,
            extent=QUICK if quick else Size(),
        )

    @property
    def repeated(self) -> str:
        """Name of the strip that is folded several times."""
        return FAVOURITE if FAVOURITE in self.strips else self.strips[0]


def _check_names(
    names: tuple[str, ...], known: tuple[str, ...], option: str
) -> tuple[str, ...]:
    """`names` without repetitions; ConfigurationError, with `option`, for a name not
    `known`.
    """
    wanted = tuple(dict.fromkeys(names))
    for name in wanted:
        check_known(f"--{option}", name, known)
    return wanted


def split(given: str | None) -> tuple[str, ...]:
    """Split a comma-separated list of names such as `denim,blanket`."""
    return tuple(part.strip() for part in (given or "").split(",") if part.strip())


def finite_or_none(values: Array) -> tuple[float | None, ...]:
    """Convert `values` (n,) to plain numbers, None where they are not finite."""
    return tuple(float(value) if np.isfinite(value) else None for value in values)


class ImageFold(Settings):
    """Result of one fold through images on the twin, recorded in the folder `run`.

    `displacement` as the camera saw it and the true one are in m, None without a touch,
    as is `edge_offset_true` between the laid edges and `bending_length`; times are in
    s.
    """

    kind: Literal["fold"] = "fold"
    strip: str
    bending_length: float
    retardation_time: float
    policy: str
    seed: int
    outcome: str
    reason: str
    displacement: float | None
    displacement_true: float | None
    edge_offset_true: float | None = None
    duration: float
    wall: float
    run: str


def displacements(folds: Sequence[ImageFold]) -> Array:
    """Displacements (n,) [m] that the camera saw in `folds`; NaN without a touch."""
    return np.array([fold.displacement for fold in folds], dtype=np.float64)


class RangeFolds(Settings):
    """Results of a policy over a logarithmic grid of side x side strips, stiffness
    outermost.

    `displacement` [m] is None without a touch, `force` [N] the mean one that holds the
    fixed edge from the take-over on. Observations are simulated.
    """

    kind: Literal["range"] = "range"
    policy: str
    engine: EngineName
    side: int
    displacement: tuple[float | None, ...]
    force: tuple[float, ...]

    @property
    def displacement_grid(self) -> Array:
        """Displacements (side, side) [m], by stiffness and damping; NaN without a
        touch.
        """
        return np.array(self.displacement, dtype=np.float64).reshape(
            self.side, self.side
        )


class EffectFolds(Settings):
    """Displacements [m] of `policy` in the rod with `effect` hidden; None where no
    layers touch.
    """

    kind: Literal["effect"] = "effect"
    policy: str
    effect: str
    displacement: tuple[float | None, ...]


class MissingPart(Settings):
    """Part of a benchmark that was not measured, and the reason."""

    kind: Literal["refused"] = "refused"
    part: str
    reason: str


PolicyResult = TypeVar("PolicyResult", ImageFold, RangeFolds, EffectFolds)
Result = ImageFold | RangeFolds | EffectFolds | MissingPart
AnyResult = Annotated[Result, Field(discriminator="kind")]


class Results(VersionedFile):
    """Contents of benchmark.json: specification, results, versions."""

    asked: BenchmarkSpec
    made_with: dict[str, str]
    speed: float
    results: tuple[AnyResult, ...]

    def folds(self, policy: str) -> tuple[ImageFold, ...]:
        """First fold of each strip by `policy`, in the requested order."""
        found = {
            f.strip: f for f in self._of(ImageFold, policy) if f.seed == self.asked.seed
        }
        return tuple(found[strip] for strip in self.asked.strips if strip in found)

    def repeats(self, policy: str) -> tuple[ImageFold, ...]:
        """All folds of the repeated strip by `policy`."""
        folds = [
            f for f in self._of(ImageFold, policy) if f.strip == self.asked.repeated
        ]
        return tuple(sorted(folds, key=lambda fold: fold.seed))

    def over_range(self, policy: str, engine: str) -> RangeFolds | None:
        """Folds of `policy` over the grid of stiffness and damping; None if not
        measured.
        """
        found = self._of(RangeFolds, policy)
        return next((folds for folds in found if folds.engine == engine), None)

    def hidden_folds(self, policy: str) -> tuple[EffectFolds, ...]:
        """Folds of `policy` on strips with hidden effects, in the order of
        measurement.
        """
        return tuple(self._of(EffectFolds, policy))

    def _of(self, kind: type[PolicyResult], policy: str) -> list[PolicyResult]:
        """Results of the class `kind` by `policy`."""
        return [r for r in self.results if isinstance(r, kind) and r.policy == policy]
