"""A training of the critic gives the same weights again, however it is interrupted."""

from pathlib import Path

import numpy as np
import pytest

from cell.base.campaign.processes import workers
from drivers.base.errors import ConfigurationError
from policies.adaptive.critic import ARRAY_NAMES, Critic
from policies.adaptive.train import shard
from policies.adaptive.train.shard import CriticSettings

TINY = CriticSettings(
    pieces=(1,),
    trials=1,
    folds=64,
    perturbation=(0.0,),
    epochs=(2,),
    segments=20,
)


def trained(
    folder: Path, settings: CriticSettings = TINY, stop_after: int = 99
) -> Critic | None:
    """The critic of a training in `folder`; None where it is left after so many
    steps.
    """
    from policies.adaptive.train.training import CriticTraining  # and PyTorch

    training = CriticTraining(settings, folder)
    with workers(1) as calls:
        for done, _ in enumerate(training.run(calls), 1):
            if done == stop_after:
                return None
    return training.policy.critic


def test_shards_of_two_rounds_fold_other_strips(monkeypatch) -> None:
    monkeypatch.setattr(shard, "_fold_strips", lambda _, strips, **__: strips)
    monkeypatch.setattr(shard, "concatenate", lambda batches: batches[0])
    one, other = (shard.simulate(TINY, turn, 0, None) for turn in range(2))
    assert one != other


@pytest.mark.slow  # three trainings
def test_same_seed_gives_the_same_weights_and_so_does_a_resumed_training(
    tmp_path: Path,
) -> None:
    whole = trained(tmp_path / "whole")
    assert trained(tmp_path / "broken", stop_after=1) is None
    again = trained(tmp_path / "broken")
    for name in ARRAY_NAMES:
        np.testing.assert_array_equal(whole.weights[name], again.weights[name])
    assert (tmp_path / "whole" / "adaptive.npz").read_bytes() == (
        tmp_path / "broken" / "adaptive.npz"
    ).read_bytes()


@pytest.mark.slow  # PyTorch
def test_folder_of_another_training_is_refused(tmp_path: Path) -> None:
    from policies.adaptive.train.training import CriticTraining

    CriticTraining(TINY, tmp_path)
    with pytest.raises(ConfigurationError, match="was begun with other settings"):
        CriticTraining(TINY.model_copy(update={"seed": 1}), tmp_path)
