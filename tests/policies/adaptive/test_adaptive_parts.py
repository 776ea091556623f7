"""Parts of the policy `adaptive`: its window of images, its path, its weights on
disk.
"""

from pathlib import Path

import numpy as np
import pytest

from drivers.base.errors import ConfigurationError
from policies.adaptive.checkpoint import COMMITTED, about, load_critic, save_critic
from policies.adaptive.features import COUNT
from policies.policy import Observation
from policies.registry import make_policy


def test_weights_come_back_as_they_were_saved(tmp_path: Path) -> None:
    critic = load_critic()
    save_critic(tmp_path / "again.npz", critic, {"note": "copy"})
    again = load_critic(tmp_path / "again.npz")
    inputs = np.random.default_rng(0).normal(size=(3, COUNT)) * 0.1
    whitened = critic.whiten(inputs)
    memory = critic.memorise(whitened)
    np.testing.assert_array_equal(
        critic.predict(whitened, memory).displacement,
        again.predict(whitened, memory).displacement,
    )
    assert about(tmp_path / "again.npz")["note"] == "copy"


def spoilt(path: Path, how: str) -> None:
    """A file of weights that is broken in one way."""
    with np.load(COMMITTED) as held:
        arrays = {name: held[name] for name in held.files}
    match how:
        case "text":
            path.write_text("hello")
            return
        case "pickle":
            np.savez(path, **arrays | {"mean": np.array([object()])})
            return
        case "shape":
            arrays["first"] = arrays["first"][:, 1:]
        case "nan":
            arrays["last"] = np.full_like(arrays["last"], np.nan)
        case "lacking":
            del arrays["second"]
        case "other":
            arrays["about"] = np.array('{"schema": 1, "policy": "feedback"}')
    np.savez(path, **arrays)


@pytest.mark.parametrize("how", ["text", "pickle", "shape", "nan", "lacking", "other"])
def test_spoilt_weights_are_refused_with_one_line(tmp_path: Path, how: str) -> None:
    path = tmp_path / "weights.npz"
    spoilt(path, how)
    with pytest.raises(
        ConfigurationError, match=r"weights\.npz: checkpoint"
    ) as refused:
        load_critic(path)
    assert "\n" not in str(refused.value)


def test_weights_that_unpack_to_more_than_there_may_be_are_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("policies.adaptive.checkpoint.LARGEST_UNPACKED", 1000)
    with pytest.raises(ConfigurationError, match=r"adaptive\.npz.*unpacks to \d+ MB"):
        load_critic(COMMITTED)


def test_first_image_moves_the_line_at_once() -> None:
    policy = make_policy("adaptive")
    before = policy.rise
    curve = np.linspace((0.2, 0.0), (0.0, 0.2), 12)[None]
    policy.decide(Observation(*np.zeros((7, 1)), curve, np.ones(1)))
    assert policy.rise != pytest.approx(before)


@pytest.mark.parametrize(("length", "speed"), [(0.3, 0.1), (1.0, 0.1), (0.6, 0.05)])
def test_strip_or_speed_that_was_not_trained_is_refused(
    length: float, speed: float
) -> None:
    from drivers.strip.file import paper_strip

    policy = make_policy("adaptive")
    with pytest.raises(ConfigurationError, match=r"adaptive: .* policy knows"):
        policy.reset(paper_strip(0.1, 0.01, length=length), speed, 1)
