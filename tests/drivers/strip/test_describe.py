"""A description is made once for the same strip, and never shared by unlike ones."""

from drivers.strip.describe import describe
from tests.support.effect_cases import denim


def test_the_same_strip_is_described_once() -> None:
    assert describe(denim()) is describe(denim())
    assert describe(denim(), {"desk_tilt": {"angle": 0.01}}, 2) is describe(
        denim(), {"desk_tilt": {"angle": 0.01}}, 2
    )


def test_strips_that_differ_in_one_number_are_described_each() -> None:
    plain = describe(denim())
    assert describe(denim(bending_length=0.0171)) is not plain
    assert describe(denim(effects={"pre_curl": {"curvature": 0.1}})) is not plain
    assert describe(denim(), {"desk_tilt": {"angle": 0.01}}) is not plain
    assert describe(denim(), index=1) is not plain
