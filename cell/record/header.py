"""What stands at the head and at the end of a run: run.yaml and result.yaml."""

from typing import Annotated, Literal, Self

from pydantic import ConfigDict, Field, model_validator

from drivers.settings import Settings

Positive = Annotated[float, Field(gt=0)]


class Recorded(Settings):
    """Base of what a program writes: unknown keys are kept, missing and broken ones refused."""

    model_config = ConfigDict(extra="allow")

    schema_: Literal[1] = Field(1, alias="schema")


class Sigma(Settings):
    """One-sigma noise of what a run measures: [m], and `touch_time` [s]."""

    model_config = ConfigDict(extra="allow")

    contact_x: Positive
    profile: Positive
    gripper: Positive
    displacement: Positive
    touch_time: Positive | None = None


class Header(Recorded):
    """run.yaml: what every reader of a measured run needs; a run of the cell adds how it was made.

    Known additions, all optional: `policy`, `seed`, `drivers`, `versions`, `calibration`
    ({id, error [m]}), `preflight` (list of checks), `config`, `plant_sha256`.
    """

    strip: str = Field(min_length=1)
    sigma: Sigma
    start: Literal["flat", "hanging"] = "flat"
    index: int | None = None
    condition: str | None = None
    speed: Positive | None = None
    camera_hz: Positive | None = None
    contact_height: Positive = 0.001


class Result(Recorded):
    """result.yaml: the outcome, and with layer_touch its time [s] and lengths [m]."""

    outcome: str = Field(min_length=1)
    t_layer_touch: float | None = None
    displacement: float | None = None
    l1: float | None = None
    l2: float | None = None

    @model_validator(mode="after")
    def _touch_is_whole(self) -> Self:
        needed = ("t_layer_touch", "displacement", "l1", "l2")
        missing = [key for key in needed if getattr(self, key) is None]
        if self.outcome == "layer_touch" and missing:
            raise ValueError(f"outcome layer_touch needs {', '.join(missing)} too")
        return self
