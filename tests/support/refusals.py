"""Refusals of bad input."""

import pytest

from drivers.base.errors import ConfigurationError


def refusal(match: str) -> pytest.RaisesExc[ConfigurationError]:
    """Context in which an input must be refused by a text that holds `match`, a regular
    expression.
    """
    return pytest.raises(ConfigurationError, match=match)
