"""Causes outside the library, at sizes that leave a gap of about 2.5 and of about 6 on denim.

A touched lens is not among them: up to a k1 of 0.25 the refitted base leaves nothing of it
(`images-2031-052`, `images-2031-059`), and from 0.3 on the preflight refuses to fold.
"""

from collections.abc import Mapping
from types import MappingProxyType

from cell.exam.case import Strength, Values

OUTSIDE: Mapping[str, Mapping[Strength, Values]] = MappingProxyType(
    {
        "draught": {"medium": {"speed": 0.35}, "strong": {"speed": 0.55}},
        "static_cling": {"medium": {"pressure": 5.0}, "strong": {"pressure": 15.0}},
        "broken_in": {"medium": {"factor": 0.45}, "strong": {"factor": 0.3}},
        "humidity": {"medium": {"spread": 0.45}, "strong": {"spread": 0.8}},
        "wobble": {"medium": {"amplitude": 0.003}, "strong": {"amplitude": 0.006}},
        "clock_drift": {"medium": {"drift": 0.006}, "strong": {"drift": 0.015}},
    }
)
