"""A cell learns the bias of its folds, and notices when something moved."""

import numpy as np
import pytest

from cell.folding.bias import bias, laid_offset
from cell.folding.experience import Experience

REPEAT = 2e-4  # m, scatter of one specimen's folds


def noise_of(folds: int, seed: int) -> np.ndarray:
    """Scatter (n,) [m] of as many `folds` of one specimen."""
    return REPEAT * np.random.default_rng(seed).standard_normal(folds)


def folded(
    number: int, error: float, specimen: str = "a", strip: str = "denim"
) -> Experience:
    return Experience(
        f"run-{number}", "adaptive", strip, specimen, "camera", displacement=error
    )


def series(errors, specimen: str = "a") -> list[Experience]:
    return [
        folded(number, float(error), specimen) for number, error in enumerate(errors)
    ]


def test_a_cell_without_folds_has_no_bias() -> None:
    found = bias([], "denim", "a")
    assert (found.seen, found.rig, found.folds, found.since) == (0.0, 0.0, 0, None)


@pytest.mark.parametrize("error", [-0.004, -0.001, 0.002, 0.005])
@pytest.mark.parametrize("seed", range(5))
def test_after_four_folds_of_a_specimen_its_bias_is_known_within_half_a_millimetre(
    error: float, seed: int
) -> None:
    noise = noise_of(4, seed)
    found = bias(series(error + noise), "denim", "a")
    assert abs(found.seen - error) < 5e-4
    assert found.since is None


def test_one_fold_teaches_another_specimen_less_than_its_own() -> None:
    once = [folded(0, 0.003)]
    own, other, stranger = (
        bias(once, *of).seen for of in (("denim", "a"), ("denim", "b"), ("twill", "c"))
    )
    assert own > other > stranger > 0


@pytest.mark.parametrize("moved", [-0.003, -0.0015, 0.0015, 0.003])
@pytest.mark.parametrize("seed", range(5))
def test_a_change_is_noticed_within_two_folds(moved: float, seed: int) -> None:
    noise = noise_of(7, seed)
    errors = np.array([0.001] * 5 + [0.001 + moved] * 2) + noise
    found = bias(series(errors), "denim", "a")
    assert found.since in {"run-5", "run-6"}
    assert abs(found.seen - errors[-2:].mean()) < 6e-4


@pytest.mark.parametrize("wild", [-0.004, -0.002, 0.002, 0.004])
@pytest.mark.parametrize("after", [1, 2, 5])
def test_a_wild_fold_teaches_nothing_and_is_no_change(wild: float, after: int) -> None:
    noise = noise_of(after + 3, after)
    errors = noise.copy()
    errors[after] += wild
    for known in (after + 1, after + 2, after + 3):
        found = bias(series(errors[:known]), "denim", "a")
        assert found.since is None
        assert abs(found.seen) < 3e-4


def test_a_steady_cell_hardly_ever_seems_to_change() -> None:
    noticed = 0
    for seed in range(100):
        noise = noise_of(20, seed)
        noticed += bias(series(noise), "denim", "a").since is not None
    assert noticed <= 2


def test_a_right_cell_is_not_made_worse_by_more_than_a_tenth_of_a_millimetre() -> None:
    plain, learned = [], []
    for seed in range(50):
        rng = np.random.default_rng(seed)
        errors = rng.normal(0.0, 5e-4) + REPEAT * rng.standard_normal(10)
        for number, error in enumerate(errors):
            known = bias(series(errors[:number]), "denim", "a")
            plain.append(abs(error))
            learned.append(abs(error - known.seen))
    assert np.mean(learned) < np.mean(plain) + 1e-4


def test_a_ruler_teaches_only_what_the_camera_does_not_see() -> None:
    ruler = Experience("run-0", "adaptive", "denim", "a", "ruler", rig=0.003)
    found = bias([folded(0, 0.001), ruler], "denim", "a")
    assert found.rig == pytest.approx(0.003, abs=2e-4)
    assert found.seen == pytest.approx(bias([folded(0, 0.001)], "denim", "a").seen)


def laid(*edges: float | None) -> list[Experience]:
    """Folds of one specimen whose edges ended up so far apart, as seen [m]."""
    return [
        Experience(f"run-{k}", "adaptive", "denim", "a", "camera", edges=offset)
        for k, offset in enumerate(edges)
    ]


@pytest.mark.parametrize("offset", [-0.004, -0.003, 0.003, 0.004])
def test_edges_that_a_cell_lays_off_are_laid_right_after_one_fold(
    offset: float,
) -> None:
    assert abs(laid_offset(laid(offset), 0.0) - offset) < 5e-4


def test_a_ruler_says_that_the_camera_is_off_and_the_edges_are_not() -> None:
    assert abs(laid_offset(laid(-0.004, -0.0041), 0.004)) < 2e-4
    ruler = Experience("run-1", "adaptive", "denim", "a", "ruler", rig=0.004)
    assert abs(bias([*laid(-0.004, -0.0041), ruler], "denim", "a").laid) < 2e-4
