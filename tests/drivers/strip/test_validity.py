"""Strips beyond what the engines were measured for: doubted, or refused where none
holds.
"""

import pytest
import yaml

from cell.base.config.places import find_configs
from drivers.base.errors import ConfigurationError
from drivers.strip.describe import BOUNDS, doubts, load_plant, load_strip


def written(tmp_path, **changes):
    content = yaml.safe_load(find_configs(None).strip_path("denim").read_text())
    path = tmp_path / "odd.yaml"
    path.write_text(yaml.safe_dump({**content, **changes}))
    return path


@pytest.mark.parametrize("load", [load_strip, load_plant])
def test_a_strip_on_which_the_chain_diverges_is_refused_when_it_is_read(
    tmp_path, load
) -> None:
    path = written(tmp_path, bending_length=0.002)
    with pytest.raises(ConfigurationError) as caught:
        load(path)
    assert str(caught.value).startswith(
        f"{path}: bending_length over length: is 0.00333"
    )
    assert "chain (the twin)" in str(caught.value)
    assert "diverges" in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "engine"),
    [
        ({"bending_length": 0.007}, "chain"),
        ({"length": 0.1, "bending_length": 0.05}, "rod"),
        ({"retardation_time": 10.0}, "chain"),
        ({"thickness": 0.008}, "rod"),
    ],
)
def test_a_strip_outside_the_validated_range_is_doubted(
    tmp_path, changes, engine
) -> None:
    said = doubts(load_strip(written(tmp_path, **changes)))
    assert said
    assert any(engine in doubt for doubt in said)
    assert all(doubt.startswith("denim: ") for doubt in said)


def test_the_strips_and_plants_of_the_package_are_within_all_bounds() -> None:
    configs = find_configs(None)
    known = [configs.strip(name) for name in configs.strip_names()]
    known += [
        load_plant(path) for path in sorted((configs.folder / "plants").glob("*.yaml"))
    ]
    assert [doubts(strip) for strip in known] == [()] * len(known)
    assert all(bound.refused < bound.low < bound.high for bound in BOUNDS)
