"""Machine code of kernels is kept by content: in which checkout they lie does not
matter.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import drivers

SCRIPT = """
from drivers.strip.shape import layer_touch
_, x, _ = layer_touch((1.0, 0.0, 0.0), (0.0, 3.0, 0.0), 0.0)
print(x, sum(layer_touch.stats.cache_hits.values()))
"""


def _copy_of_sources(at: Path) -> Path:
    shutil.copytree(Path(drivers.__file__).parent, at / "drivers")
    return at


def _largest_and_hits(sources: Path, cache: Path) -> tuple[str, ...]:
    """Where the kernel of `sources` finds the touch, and how many of its codes were in `cache`."""
    environment = {
        **os.environ,
        "PYTHONPATH": str(sources),
        "NUMBA_CACHE_DIR": str(cache),
    }
    command = [sys.executable, "-P", "-c", SCRIPT]
    told = subprocess.run(
        command, env=environment, capture_output=True, text=True, check=True
    )
    return tuple(told.stdout.split())


@pytest.mark.slow
def test_second_checkout_compiles_nothing_and_changed_sources_anew(
    tmp_path: Path,
) -> None:
    first, second = (
        _copy_of_sources(tmp_path / "first"),
        _copy_of_sources(tmp_path / "second"),
    )
    cache = tmp_path / "cache"
    assert _largest_and_hits(first, cache) == ("3.0", "0")
    assert _largest_and_hits(second, cache) == ("3.0", "1")
    # as a power cut may leave it
    for size, fill in ((0, b""), (500, b""), (0, bytes(500))):
        for kept in cache.rglob("*.nbc"):
            kept.write_bytes(kept.read_bytes()[:size] + fill)
        assert _largest_and_hits(second, cache) == ("3.0", "0")
    with (second / "drivers" / "base" / "types.py").open(
        "a", encoding="utf-8"
    ) as imported:
        imported.write("# changed\n")
    assert _largest_and_hits(second, cache) == ("3.0", "0")


def test_kernel_runs_where_no_code_can_be_kept(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("not a folder", encoding="utf-8")
    assert _largest_and_hits(Path(drivers.__file__).parents[1], blocked) == ("3.0", "0")
