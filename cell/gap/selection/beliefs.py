"""Prior beliefs about effects and the errors of their laws.

`python -m tests.lab study beliefs` fits them.
"""

from functools import cache
from pathlib import Path

from pydantic import Field

from drivers.settings import Seconds, Settings, load

BELIEFS_FILE = Path(__file__).with_suffix(".yaml")


class Beliefs(Settings):
    """Content of beliefs.yaml: what is believed of the effects before runs are seen.

    Of the library `expected` effects are present; an `immaterial` one responds with this share (one
    sigma) of what the floor allows; a law is wrong by a share of what it explains, half-normal of
    sigma `wrong`, summed over `shares`, with a correlation time `memory` [s]. `source` says where
    the numbers come from, `belongs_to` the place of the file.
    """

    expected: float = Field(gt=0.0)
    immaterial: float = Field(ge=0.0)
    wrong: float = Field(gt=0.0)
    shares: tuple[float, ...] = Field(min_length=1)
    memory: Seconds = Field(gt=0.0)
    source: str = Field(min_length=1)
    belongs_to: str = ""


@cache
def beliefs() -> Beliefs:
    """Load the beliefs that the package ships."""
    return load(BELIEFS_FILE, Beliefs)
