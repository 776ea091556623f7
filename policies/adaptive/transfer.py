"""What folds through images taught about a critic that was trained in the rod."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Self

from pydantic import TypeAdapter, ValidationError

from policies.adaptive.bias import Bias

LARGEST_NUMBER = 100.0  # of any number: none is near it


@dataclass(frozen=True, slots=True)
class Transfer:
    """`bias` of the displacement that the critic predicts.

    The default is that of folds like those of the training: none.
    """

    bias: Bias = field(default_factory=Bias)

    def facts(self) -> dict[str, Any]:
        """Plain values, for the checkpoint."""
        return asdict(self)

    @classmethod
    def read(cls, facts: Mapping[str, Any]) -> Self:
        """The transfer with these `facts`; raises ValueError where they are none."""
        try:
            found = TypeAdapter(cls).validate_python(facts)
        except ValidationError as error:
            raise ValueError(str(error.errors()[0]["msg"])) from None
        if not all(abs(number) < LARGEST_NUMBER for number in asdict(found.bias).values()):
            raise ValueError(f"needs all numbers below {LARGEST_NUMBER:g}")
        return found
