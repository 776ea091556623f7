"""Trial folds of a finished critic: its errors, and factors that calibrate its uncertainty."""

from dataclasses import dataclass

import numpy as np

from drivers.types import Array
from policies.adaptive.critic import Critic, Judgement
from policies.adaptive.train.piece import Piece

LAST = 16  # kept decisions before the touch, about a second, on which sigmas are set
ONE, TWO = 1.0, 1.96
COVERAGES = ((0.68, ONE), (0.95, TWO))  # share of outcomes, and sigmas that are to hold it


@dataclass(frozen=True, slots=True)
class Trial:
    """Results of trial folds: mean, 95 % quantile, worst |d| [m]; shares within 1, 1.96 sigma."""

    folds: int
    untouched: int
    mean: float
    most: float
    worst: float
    within: tuple[float, float]

    def facts(self) -> dict[str, object]:
        """The errors of the trial as the checkpoint records them."""
        return {name: getattr(self, name) for name in self.__slots__}


def calibrate_sigmas(critic: Critic, piece: Piece) -> tuple[Critic, Trial]:
    """`critic` with sigmas scaled to cover the errors in `piece`, and the results of the trial."""
    ratios = error_ratios(critic, piece)
    critic = critic.with_stretch(np.array([_stretch(each) for each in ratios]))
    at_touch = error_ratios(critic, piece, last=1)[0]
    miss = np.abs(piece.displacement)
    return critic, Trial(
        folds=len(miss),
        untouched=int(np.isnan(miss).sum()),
        mean=float(np.nanmean(miss)),
        most=float(np.nanquantile(miss, 0.95)),
        worst=float(np.nanmax(miss)),
        within=(float(np.mean(at_touch < ONE)), float(np.mean(at_touch < TWO))),
    )


def error_ratios(critic: Critic, piece: Piece, last: int = LAST) -> list[Array]:
    """Four arrays (m,) |error| / sigma, of d and the strip, in the `last` decisions of folds."""
    ratios: list[list[Array]] = [[] for _ in range(4)]
    count = len(piece.displacement)
    memory, counted = np.zeros((count, critic.memory)), np.zeros((count, 1))
    to_touch = piece.alive[:, ::-1].cumsum(axis=1)[:, ::-1]  # decisions from each to the touch
    for k in range(piece.alive.shape[1]):
        alive = piece.alive[:, k]
        whitened = critic.whiten(piece.inputs[:, k].astype(np.float64))
        memory += alive[:, None] * critic.memorise(whitened)
        counted += alive[:, None]
        judged = critic.judge(whitened, memory / np.maximum(counted, 1))
        near = alive & (to_touch[:, k] <= last) & np.isfinite(piece.displacement)
        for kept, ratio in zip(ratios, _ratios(judged, piece), strict=True):
            kept.append(ratio[near])
    return [np.concatenate(kept) for kept in ratios]


def _ratios(judged: Judgement, piece: Piece) -> list[Array]:
    """Ratios |error| / sigma (n,) of a prediction of n folds: displacement, then strip."""
    displacement = np.abs(piece.displacement - judged.displacement) / judged.sigma
    strip = [
        np.abs(true - estimate[:, 0]) / estimate[:, 1]
        for true, estimate in zip(piece.strip.T, judged.belief, strict=True)
    ]
    return [displacement, *strip]


def _stretch(ratios: Array) -> float:
    """Factor on sigma with which the shares within 1 and 1.96 sigma are nearest to normal."""
    needed = [np.quantile(ratios, share) / sigmas for share, sigmas in COVERAGES]
    return float(np.sqrt(np.prod(needed)))
