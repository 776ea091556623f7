"""One case of the exam: the plant with its hidden cause, and the names that count as
right.
"""

from typing import Annotated, Literal

from pydantic import Field

from drivers.base.settings import Settings

Tier = Literal["state", "images"]
Kind = Literal["nothing", "single", "pair", "outside"]
Strength = Literal["weak", "medium", "strong"]
ScatterLevel = Literal["none", "half", "full"]
Motions = Literal["standard", "by_hand"]
Plant = Literal["the model itself", "another engine", "another law"]

STRENGTHS: dict[Strength, float] = {"weak": 1.0, "medium": 2.5, "strong": 6.0}
"""Excess gap that each strength leaves after the base parameters are refitted."""

Factor = Annotated[float, Field(gt=0.2, lt=5.0)]
Values = dict[str, float]


class Case(Settings):
    """One case of the exam: a plant that differs from its strip file, and how its runs
    are made.

    `strip` names a file of configs/strips, which is all that the workflow is given. The
    plant has its bending length and retardation time times the factors, the library's
    `effects` (exactly their laws) and the `causes` that only the makers know, by name
    and parameters.
    `answer` are the names that are right: those of the effects, and of effects that a
    cause resembles though its law is another one (`alike` false); empty where nothing
    or nothing of the library is hidden. `scatter` says how much runs differ for no
    reason, `motions` how the gripper moves. From the state, the plant is the `engine`:
    the rod that the model is too, or a chain, which alone has `causes` in it.
    """

    name: str = Field(pattern=r"^[a-z0-9][a-z0-9-]*$")
    tier: Tier
    kind: Kind
    strip: str
    seed: int = Field(ge=0)
    engine: Literal["rod", "chain"] = "rod"  # of the state-based tier
    stiffness: Factor = 1.0  # factor on the bending length
    damping: Factor = 1.0  # factor on the retardation time
    effects: dict[str, Values] = Field(default_factory=dict)
    causes: dict[str, Values] = Field(default_factory=dict)
    answer: tuple[str, ...] = ()
    strength: Strength | None = None
    scatter: ScatterLevel = "none"
    motions: Motions = "standard"

    @property
    def plant(self) -> Plant:
        """Kind of the plant: the model's own engine, another engine, or one with other
        laws.
        """
        if self.causes and self.answer:
            return "another law"
        own = self.tier == "state" and self.engine == "rod"
        return "the model itself" if own else "another engine"

    @property
    def alike(self) -> bool:
        """Whether the plant follows the library's laws, so that parameters can be
        compared.
        """
        return not self.causes
