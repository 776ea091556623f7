"""Specification of a benchmark: policies, strips, repeats, sizes."""

from typing import Self

from pydantic import Field

from cell.config.places import Configs
from drivers.errors import ConfigurationError
from drivers.settings import Settings
from policies.registry import policy_names

FAVOURITE = "denim"
QUICK_FABRICS = ("blanket", "denim", "rib-knit")  # stiff, middling, soft and slow


class Size(Settings):
    """Size of a benchmark: numbers of simulated strips, and `heights` [m] of critical points.

    `grid` and `chain` are sides of the grids of strips in either engine, `hidden` strips by effect.
    """

    grid: int = Field(12, ge=2)
    chain: int = Field(5, ge=2)
    stiffnesses: int = Field(7, ge=2)
    dampings: int = Field(5, ge=2)
    heights: tuple[float, ...] = (0.06, 0.10, 0.14, 0.18, 0.22, 0.26)
    laid: int = Field(4, ge=1)
    hidden: int = Field(24, ge=2)


QUICK = Size(
    grid=4, chain=2, stiffnesses=3, dampings=2, heights=(0.10, 0.18, 0.26), laid=2, hidden=4
)


class BenchmarkSpec(Settings):
    """Scope of a benchmark: policies and strips by name, `repeats` of one strip, seed and size."""

    policies: tuple[str, ...]
    strips: tuple[str, ...]
    repeats: int = Field(5, ge=1)
    seed: int = Field(0, ge=0)
    extent: Size = Size()

    @classmethod
    def of(
        cls,
        configs: Configs,
        policies: tuple[str, ...],
        strips: tuple[str, ...],
        repeats: int | None,
        seed: int,
        *,
        quick: bool,
    ) -> Self:
        """Make the specification from options of the command line; no names mean all known ones.

        Raises ConfigurationError for an unknown name.
        """
        known = configs.strip_names()
        usual = tuple(name for name in QUICK_FABRICS if name in known) if quick else known
        return cls(
            policies=_check_names(policies or policy_names(), policy_names(), "policies"),
            strips=_check_names(strips or usual or known, known, "strips"),
            repeats=repeats or (2 if quick else 5),
            seed=seed,
            extent=QUICK if quick else Size(),
        )

    @property
    def repeated(self) -> str:
        """Name of the strip that is folded several times."""
        return FAVOURITE if FAVOURITE in self.strips else self.strips[0]


def _check_names(names: tuple[str, ...], known: tuple[str, ...], option: str) -> tuple[str, ...]:
    wanted = tuple(dict.fromkeys(names))
    for name in wanted:
        if name not in known:
            raise ConfigurationError(
                f"--{option}: unknown name {name!r}; allowed: {', '.join(known) or 'none'}"
            )
    return wanted


def split(given: str | None) -> tuple[str, ...]:
    """Split a comma-separated list of names such as `denim,blanket`."""
    return tuple(part.strip() for part in (given or "").split(",") if part.strip())
