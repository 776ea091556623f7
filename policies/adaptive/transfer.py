"""What folds through images taught about a critic that was trained in the rod."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Self

import numpy as np
from pydantic import TypeAdapter, ValidationError

from policies.adaptive.bias import Bias
from policies.adaptive.roll import TERMS, Roll

LARGEST = 100.0  # of any number: none is near it


@dataclass(frozen=True, slots=True)
class Transfer:
    """`bias` of the displacement that the critic predicts, and the `roll` after the touch.

    The default is that of folds like those of the training: no bias, and an aim at d = 0.
    """

    bias: Bias = field(default_factory=Bias)
    roll: Roll = field(default_factory=Roll)

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
        numbers = np.array([*asdict(found.bias).values(), *found.roll.weights])
        if len(found.roll.weights) != TERMS or not (np.abs(numbers) < LARGEST).all():
            raise ValueError(f"needs {TERMS} weights of the roll, all numbers below {LARGEST:g}")
        return found
