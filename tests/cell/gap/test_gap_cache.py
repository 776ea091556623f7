"""What a fit keeps on disk on its way."""

import shutil

import numpy as np
import pytest

from cell.gap.fitting.cache import SimulationCache
from cell.gap.subject.subject import Residuals
from drivers.errors import ConfigurationError


def test_a_folder_that_was_deleted_meanwhile_is_one_clear_line(tmp_path) -> None:
    answer = [Residuals(np.zeros(2), np.zeros(2))]
    cache = SimulationCache(lambda _: answer, tmp_path / "rounds" / "key")
    assert cache([]) == answer
    shutil.rmtree(tmp_path / "rounds")
    with pytest.raises(ConfigurationError, match=r"00001\.npz: cannot be written: No such file"):
        cache([])
