"""What a fit keeps on disk on its way."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

from cell.gap.fitting.tasks import SimulationCache
from cell.gap.subject.subject import Request, Residuals, Run, Samples
from drivers.errors import ConfigurationError


def test_a_folder_that_was_deleted_meanwhile_is_one_clear_line(tmp_path) -> None:
    cache, later = (SimulationCache(list, tmp_path / "rounds" / "key") for _ in range(2))
    assert cache([]) == later([]) == []  # the later one reads the empty round back
    shutil.rmtree(tmp_path / "rounds")
    with pytest.raises(ConfigurationError, match=r"00001\.npz: cannot be written: No such file"):
        cache([])


def test_answers_for_a_run_are_not_taken_for_the_same_run_corrected_otherwise(tmp_path) -> None:
    words, ones = np.array(["profile"] * 2), np.ones(2)
    samples = Samples(words, words, words, words, ones, ones, ones, ones, np.zeros(2, np.int64))
    run = Run("fast", "fast", samples, common={"damping": ones})
    finer = replace(run, samples=replace(samples, floor=2.0 * ones))
    slopes = replace(run, common={"damping": 2.0 * ones})
    simulated = []

    def simulate(requests):
        simulated.extend(request.run for request in requests)
        return [Residuals(request.run.samples.floor, ones) for request in requests]

    def resumed(run: Run) -> Residuals:
        cache = SimulationCache(simulate, tmp_path / "rounds" / "key")
        [answer] = cache([Request(run, ones, {}, np.zeros(0))])
        return answer

    for each in (run, finer, slopes):
        np.testing.assert_array_equal(resumed(each).mean, each.samples.floor)
        resumed(replace(each))
    assert simulated == [run, finer, slopes]
