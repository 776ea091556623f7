"""Correction of a critic that was trained in simulation, learned from folds through images."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Self

from pydantic import TypeAdapter, ValidationError

from policies.adaptive.bias import Bias

LARGEST_NUMBER = 100.0  # above every plausible coefficient


@dataclass(frozen=True, slots=True)
class Transfer:
    """Correction of a critic: the `bias` of the displacement that it predicts.

    The default corrects nothing, as for folds like those of the training.
    """

    bias: Bias = field(default_factory=Bias)

    def facts(self) -> dict[str, Any]:
        """The transfer as plain values, for the checkpoint."""
        return asdict(self)

    @classmethod
    def read(cls, facts: Mapping[str, Any]) -> Self:
        """The transfer from its `facts`; raises ValueError where they are not valid."""
        try:
            found = TypeAdapter(cls).validate_python(facts)
        except ValidationError as error:
            raise ValueError(str(error.errors()[0]["msg"])) from None
        if not all(abs(number) < LARGEST_NUMBER for number in asdict(found.bias).values()):
            raise ValueError(f"needs all numbers below {LARGEST_NUMBER:g}")
        return found
