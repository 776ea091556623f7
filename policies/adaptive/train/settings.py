"""Settings of a critic's training; the same settings and seed give the same weights."""

from pydantic import Field

from drivers.settings import Settings


class CriticSettings(Settings):
    """Settings of a critic's training: rounds of simulated folds, each followed by a regression.

    In the first round rises are drawn at random; in later ones the critic steers, until at a
    random moment the rise is moved by `perturbation` [m] (one sigma) and kept. Every second piece
    folds strips of 0.6 m, the others one length within `adaptive.LENGTH_RANGE`. A last round of
    `trials` pieces folds without perturbation and as images are, to set the sigmas. `friction`
    (and other effects) in training, `profile`, `tip` and `memory` can be left out, to measure
    what each contributes.
    """

    seed: int = Field(0, ge=0)
    pieces: tuple[int, ...] = (24, 32, 48)  # of folds, in each round
    trials: int = Field(4, ge=1)
    folds: int = Field(256, ge=8)  # in a piece
    perturbation: tuple[float, ...] = (0.0, 0.008, 0.005)
    epochs: tuple[int, ...] = (24, 20, 45)
    speed: float = Field(0.1, gt=0)
    segments: int = Field(100, ge=20)
    memory: int = Field(32, ge=0)
    hidden: tuple[int, int] = (128, 96)
    friction: bool = True
    profile: bool = True
    tip: bool = True

    @property
    def rounds(self) -> int:
        """Number of rounds, each of folds and a regression."""
        return len(self.pieces)
