"""Settings of a training run; the same settings and seed give the same weights."""

from pydantic import Field

from drivers.settings import Settings


class TrainingSettings(Settings):
    """Settings of CMA-ES and of the folds that evaluate its candidates.

    `strips` squared strips a generation, one from each cell of the paper's range; `force_weight` a
    [m] scales the mean holding force over the strip's weight.
    """

    seed: int = Field(0, ge=0)
    generations: int = Field(300, ge=1)
    population: int = Field(48, ge=4)
    sigma: float = Field(0.05, gt=0)
    strips: int = Field(4, ge=1)
    speed: float = Field(0.1, gt=0)
    segments: int = Field(60, ge=20)
    substeps: int = Field(2, ge=1)
    contact_sigma: float = Field(0.001, ge=0)
    contact_bias: float = Field(0.001, ge=0)
    delay: float = Field(0.06, ge=0)  # s, largest
    force_weight: float = Field(0.01, ge=0)
    validate_every: int = Field(5, ge=1)

    @property
    def folds_per_generation(self) -> int:
        """Folds that one generation simulates."""
        return self.population * self.strips**2
