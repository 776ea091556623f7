"""Regression of the critic on training folds by maximum likelihood, with torch."""

import numpy as np
import torch
from torch import Tensor, nn

from drivers.base.types import Array
from policies.adaptive.critic import (
    ARRAY_NAMES,
    DISPLACEMENT,
    INPUT_LIMIT,
    LOG_SIGMA_RANGE,
    SLOPE,
    SPREAD,
    STRIP_LOG_SIGMAS,
    STRIP_MEANS,
    UNIT,
    Critic,
    array_shapes,
)
from policies.adaptive.features import CHANNELS, STATE_SIZE
from policies.adaptive.train.shard import CriticSettings, Shard
from policies.profile import POINTS

BATCH = 64  # folds
PICKED = 28  # moments of each fold in a step of the optimiser
FIRST_RATE, LAST_RATE = 2e-3, 2e-5  # learning rates, falling along a cosine
# standard deviation to which the state is scaled before it is whitened
STATE_SPREAD = 0.1
# standard deviation of inputs under which they are not scaled to one
SMALLEST_SPREAD = 3e-4
# exponent of the weight by which uncertain moments count less (beta-NLL)
NLL_EXPONENT = 0.5
# over the length, one sigma of an error that lasts all through a fold
IMAGE_BIAS = 5e-4
BELIEF = 0.1  # weight of the strip's likelihood against that of the displacement


class Network(nn.Module):
    """Critic as a module of torch, for training, with the arrays of `Critic` as
    parameters.
    """

    def __init__(self, inputs: int, memory: int, hidden: tuple[int, int]) -> None:
        super().__init__()
        shapes = array_shapes(inputs, memory, *hidden)
        for name in ("recall", "first", "second", "last"):
            rows, columns = shapes[name]
            weight = torch.randn(rows, columns) / max(rows, 1) ** 0.5
            self.register_parameter(name, nn.Parameter(weight))
            self.register_parameter(f"{name}_bias", nn.Parameter(torch.zeros(columns)))

    def forward(self, whitened: Tensor, counted: Tensor, picked: Tensor) -> Tensor:
        """Outputs (n, p, OUTPUTS) at moments `picked` (n, p) of folds `whitened` (n, k,
        inputs).

        `counted` (n, k, 1) is 1 for the moments that enter the memory.
        """
        parameter = self.get_parameter
        recalled = (
            torch.tanh(whitened @ parameter("recall") + parameter("recall_bias"))
            * counted
        )
        memory = torch.cumsum(recalled, 1) / torch.cumsum(counted, 1).clamp(min=1.0)
        inputs = torch.cat(
            [_select_moments(whitened, picked), _select_moments(memory, picked)], dim=-1
        )
        hidden = torch.tanh(inputs @ parameter("first") + parameter("first_bias"))
        hidden = torch.tanh(hidden @ parameter("second") + parameter("second_bias"))
        return hidden @ parameter("last") + parameter("last_bias")


def _whitening(shard: Shard) -> tuple[Array, Array]:
    """Mean (k,) and matrix (k, k) that whiten the critic's inputs in `shard` before the
    touch.
    """
    inputs = shard.inputs[shard.alive].astype(np.float64)
    mean = inputs.mean(axis=0)

    scale = np.ones(inputs.shape[1])
    # a constant one is 0
    state_deviation = np.maximum(inputs[:, :STATE_SIZE].std(axis=0), 1e-6)
    scale[:STATE_SIZE] = 1.0 / state_deviation * STATE_SPREAD

    covariance = np.cov((inputs - mean) * scale, rowvar=False)
    values, vectors = np.linalg.eigh(covariance)
    spreads = np.sqrt(np.maximum(values, 0.0) + SMALLEST_SPREAD**2)
    return mean, scale[:, None] * vectors / spreads


def fit(
    shard: Shard, settings: CriticSettings, epochs: int, seed: int, start: Critic | None
) -> Critic:
    """Fit a critic to `shard` over `epochs`, from `start` or from random weights of
    `seed`.

    Deterministic: one thread, a generator of its own.
    """
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with torch.random.fork_rng():
            torch.manual_seed(seed)
            return _fit(shard, settings, epochs, start)
    finally:
        torch.set_num_threads(threads)


def _fit(
    shard: Shard, settings: CriticSettings, epochs: int, start: Critic | None
) -> Critic:
    """Fit a critic to `shard` over `epochs`, with the random numbers of torch's
    generator.
    """
    if start is None:
        mean, whiten = _whitening(shard)
    else:
        mean = start.weights["mean"]
        whiten = start.weights["whiten"]

    network = Network(len(mean), settings.memory, settings.hidden)
    if start is not None:
        network.load_state_dict(
            {n: torch.tensor(start.weights[n]) for n in network.state_dict()}
        )

    data = _tensors(shard, mean, whiten)
    _optimise(network, data, torch.tensor(whiten, dtype=torch.float32), epochs)
    arrays = {
        name: np.asarray(value.numpy()) for name, value in network.state_dict().items()
    }
    arrays |= {"mean": mean, "whiten": whiten, "stretch": np.ones(4)}
    return Critic({name: arrays[name] for name in ARRAY_NAMES})


def _optimise(
    network: Network, data: list[Tensor], whiten: Tensor, epochs: int
) -> None:
    """Minimise the loss of `network` on `data` by Adam with a cosine schedule, over
    `epochs`.

    Each batch's inputs have newly drawn biases, whitened by `whiten` (k, k).
    """
    folds = len(data[0])
    batches = folds // BATCH
    optimiser = torch.optim.Adam(network.parameters(), lr=FIRST_RATE)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(
        optimiser, epochs * batches, LAST_RATE
    )

    for _ in range(epochs):
        order = torch.randperm(folds)[: batches * BATCH]
        for batch in torch.split(order, BATCH):
            optimiser.zero_grad()
            whitened, *targets = (part[batch] for part in data)
            whitened = whitened + (_draw_image_biases(len(whitened)) @ whiten)[:, None]
            loss = _loss(network, [whitened, *targets])
            torch.autograd.backward(loss)
            optimiser.step()
            schedule.step()


def _draw_image_biases(count: int) -> Tensor:
    """Draw errors (count, inputs) of the critic's inputs in strip lengths, one set per
    fold.

    One of the contact, one of the tip, and one of the profile that changes linearly
    along it, as measured by `python -m tests.lab study perception`.
    """
    along = torch.linspace(0.0, 1.0, POINTS)[:, None]
    begin, end = IMAGE_BIAS * torch.randn(2, count, 1, 2)
    profile = (begin + (end - begin) * along).reshape(count, 2 * POINTS)
    values = torch.cat([IMAGE_BIAS * torch.randn(count, 2), profile], dim=1)
    return torch.nn.functional.pad(values, (STATE_SIZE, CHANNELS))


def _tensors(shard: Shard, mean: Array, whiten: Array) -> list[Tensor]:
    """Whitened inputs of `shard`, then the targets and masks of its folds, for
    `_loss`.
    """
    whitened = (shard.inputs - mean.astype(np.float32)) @ whiten.astype(np.float32)
    whitened = whitened.clip(-INPUT_LIMIT, INPUT_LIMIT)
    touched = np.isfinite(shard.displacement)
    predicted = shard.predicted & shard.alive & touched[:, None]
    displacement = np.nan_to_num(shard.displacement) / UNIT
    arrays = (
        whitened,
        shard.moved / UNIT,
        shard.alive,
        predicted,
        displacement,
        shard.strip,
    )
    return [torch.tensor(array, dtype=torch.float32) for array in arrays]


def _loss(network: Network, batch: list[Tensor]) -> Tensor:
    """Negative log likelihood of displacement and strip at random moments of each
    fold.
    """
    whitened, moved, alive, predicted, displacement, strip = batch
    picked = _pick_moments(alive, predicted)
    out = network(whitened, alive[..., None], picked)
    moved, alive, predicted = (
        values.gather(1, picked) for values in (moved, alive, predicted)
    )
    expected = out[..., DISPLACEMENT] + out[..., SLOPE] * moved
    log_sigma = out[..., SPREAD].clamp(*LOG_SIGMA_RANGE)
    fold_loss = _gaussian_loss(
        displacement[:, None] - expected, log_sigma, NLL_EXPONENT
    )
    strip_log_sigma = out[..., STRIP_LOG_SIGMAS].clamp(*LOG_SIGMA_RANGE)
    strip_loss = _gaussian_loss(
        strip[:, None] - out[..., STRIP_MEANS], strip_log_sigma, power=0.0
    )
    return _mean(fold_loss, predicted) + BELIEF * _mean(strip_loss.sum(dim=-1), alive)


def _pick_moments(alive: Tensor, predicted: Tensor) -> Tensor:
    """Numbers (n, p) of random moments: first of those that predict, then others before
    touch.
    """
    score = torch.rand(alive.shape) + predicted + alive
    return torch.topk(score, min(PICKED, alive.shape[1]), dim=1).indices


def _gaussian_loss(error: Tensor, log_sigma: Tensor, power: float) -> Tensor:
    """Negative log likelihood of normal errors, weighted by their variance to the power
    `power`.
    """
    loss = 0.5 * (error * torch.exp(-log_sigma)) ** 2 + log_sigma
    return loss * torch.exp(2.0 * power * log_sigma).detach() if power else loss


def _mean(values: Tensor, weight: Tensor) -> Tensor:
    return (values * weight).sum() / weight.sum().clamp(min=1.0)


def _select_moments(values: Tensor, picked: Tensor) -> Tensor:
    return values.gather(1, picked[..., None].expand(-1, -1, values.shape[-1]))
