"""Parts of the policy `adaptive`: its window of images, its path, its weights on disk."""

from pathlib import Path

import numpy as np
import pytest

from drivers.errors import ConfigurationError
from policies.adaptive.checkpoint import about, load_critic, save_critic
from policies.adaptive.critic import Belief, Prediction, median_prediction
from policies.adaptive.features import COUNT, Window
from policies.adaptive.steering import Steering
from policies.registry import make_policy

SPEED, PERIOD = 0.1, 1 / 60


def filled(values: np.ndarray) -> Window:
    """A window told one image of two channels every 60th of a second."""
    window = Window(1, 2)
    for k, value in enumerate(values):
        window.add(np.array([k * PERIOD]), value[None], np.array([True]))
    return window


def test_one_wild_image_moves_the_trend_by_less_than_its_noise() -> None:
    values = np.full((20, 2), 0.5)
    values[-3, 0] += 0.05
    trend = filled(values).trend()
    assert abs(trend.value[0, 0] - 0.5) < 1e-3
    assert trend.spread[0, 0] > 10 * trend.spread[0, 1]


def predicted(displacement: float, length: float) -> Prediction:
    """A prediction on two folds, the second one 1 mm farther."""
    each = np.array([displacement, displacement + 1e-3])
    told = np.tile((length, 0.1), (2, 1))
    return Prediction(each, np.full(2, 0.9), np.full(2, 5e-4), Belief(told, told, told))


def test_one_wild_prediction_of_five_is_not_predicted() -> None:
    usual = [predicted(1e-4 * k, -3.9 + 0.01 * k) for k in range(4)]
    found = median_prediction([*usual, predicted(-0.012, -2.0)])
    assert found.displacement == pytest.approx([1e-4, 1.1e-3], abs=1e-4)
    assert found.belief.log_bending_length[:, 0] == pytest.approx([-3.88] * 2, abs=0.02)
    assert found.sigma == pytest.approx([5e-4] * 2)


def travelled(rise: float, steps: int) -> np.ndarray:
    """Places (steps, 2) of a gripper without inertia, from the take-over on."""
    steering = Steering(0.6, SPEED, 1)
    place, places = np.array([0.5, 0.1]), []
    for _ in range(steps):
        decision = steering.decide(place[:1], place[1:], np.array([rise]))
        heading = float(decision.direction[0])
        speed = float(decision.speed[0])
        place = place + speed * PERIOD * np.array([np.cos(heading), np.sin(heading)])
        places.append(place)
    return np.array(places)


def test_gripper_comes_down_on_its_line() -> None:
    places = travelled(0.045, 330)
    x, z = places[np.argmax(places[:, 1]) + 40 :].T
    assert z - x == pytest.approx(0.045, abs=1e-4)


def test_weights_come_back_as_they_were_saved(tmp_path: Path) -> None:
    critic = load_critic()
    save_critic(tmp_path / "again.npz", critic, {"note": "copy"})
    again = load_critic(tmp_path / "again.npz")
    inputs = np.random.default_rng(0).normal(size=(3, COUNT)) * 0.1
    whitened = critic.whiten(inputs)
    memory = critic.memorise(whitened)
    np.testing.assert_array_equal(
        critic.predict(whitened, memory).displacement, again.predict(whitened, memory).displacement
    )
    assert about(tmp_path / "again.npz")["note"] == "copy"


def spoilt(path: Path, how: str) -> None:
    """A file of weights that is broken in one way."""
    with np.load(Path(make_policy.__code__.co_filename).parent / "weights/adaptive.npz") as held:
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
    with pytest.raises(ConfigurationError, match=r"weights\.npz: checkpoint") as refused:
        load_critic(path)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(("length", "speed"), [(0.3, 0.1), (1.0, 0.1), (0.6, 0.05)])
def test_strip_or_speed_that_was_not_trained_is_refused(length: float, speed: float) -> None:
    from drivers.strip.file import paper_strip

    policy = make_policy("adaptive")
    with pytest.raises(ConfigurationError, match=r"adaptive: .* policy knows"):
        policy.reset(paper_strip(0.1, 0.01, length=length), speed, 1)
