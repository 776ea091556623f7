"""What a screen says of a few effects together, and where fits of them begin."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from cell.gap.fitting.gauss_newton import Estimate
from drivers.types import Array


@dataclass(frozen=True, slots=True)
class Score:
    """Effects screened together: nats gained at `start`, their values by name.

    `linear`: found by the secants at null, which a fit from null follows by itself. `tried` are
    the values of the probes that gain most as they are: an effect with a threshold does nothing
    below it, so that a share of a probe is no start. `mirrored` is a start of the other sign, of an
    effect that has a place: elsewhere it may do with one sign what it does here with the other.
    `after` is a fit whose values and effects are kept to begin with. `secants` (N, parameters) by
    name are whitened, at null.
    """

    names: tuple[str, ...]
    gain: float
    start: dict[str, Array]
    linear: bool = True
    tried: dict[str, Array] | None = None
    mirrored: dict[str, Array] | None = None
    after: Estimate | None = None
    secants: Mapping[str, Array] = field(default_factory=dict)

    @property
    def starts(self) -> list[dict[str, Array]]:
        """Where fits begin, values (k,) by effect: what is not known yet at null always."""
        found: list[dict[str, Array]] = [{}]
        if not self.linear:
            found.append(self.start)
        if self.tried is not None:
            found.append(self.tried)
        if self.mirrored is not None:
            found.append(self.mirrored)
        return [{**self._known, **values} for values in found]

    def beside(self, fit: Estimate) -> "Score":
        """The same effects, to be tried beside those of `fit`."""
        names = tuple(sorted({*fit.model.names, *self.names}))
        return replace(self, names=names, after=fit)

    @property
    def _known(self) -> dict[str, Array]:
        if self.after is None:
            return {}
        _, effects = self.after.model.split(self.after.shared)
        return {name: values for name, values in effects.items() if name in self.names}
