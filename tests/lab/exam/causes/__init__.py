"""Hidden causes of the exam: physical laws that differ from every effect of the library.

Every module of this folder that has a `CAUSE` is one cause, named like the module, and so is every
plug-in of the kind `causes`.
"""

import importlib
import pkgutil
from collections.abc import Mapping
from functools import cache

from drivers.errors import ConfigurationError
from drivers.plugins import plugins
from drivers.settings import parse
from tests.lab.exam.causes.cause import Cause


@cache
def causes() -> Mapping[str, type[Cause]]:
    """Classes of all causes by name; raises ConfigurationError for a plug-in of another class."""
    names = sorted(name for _, name, _ in pkgutil.iter_modules(__path__))
    modules = {name: importlib.import_module(f"{__name__}.{name}") for name in names}
    own = {name: module.CAUSE for name, module in modules.items() if hasattr(module, "CAUSE")}
    added = plugins("causes", type, own)
    wrong = [name for name, cause in added.items() if not issubclass(cause, Cause)]
    if wrong:
        raise ConfigurationError(f"plug-in folding_cell.causes: {wrong[0]}: is no Cause")
    return {**own, **added}


def cause_of(name: str, values: Mapping[str, float]) -> Cause:
    """Make the cause `name` from its `values`; raises ConfigurationError if one is invalid."""
    if name not in causes():
        raise ConfigurationError(f"causes: {name}: is not known; known: {', '.join(causes())}")
    return parse(dict(values), causes()[name], f"causes: {name}")
