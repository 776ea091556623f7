"""The studies by name; every module of this folder that has a `STUDY` is one, named like it."""

import importlib
import pkgutil
from collections.abc import Mapping
from functools import cache

from cell.studies.study import Study
from drivers.errors import ConfigurationError


@cache
def studies() -> Mapping[str, Study]:
    """Studies by name, sorted."""
    names = sorted(name for _, name, _ in pkgutil.iter_modules(__path__))
    modules = (importlib.import_module(f"{__name__}.{name}") for name in names)
    found = (module.STUDY for module in modules if hasattr(module, "STUDY"))
    return {study.name: study for study in found}


def study_of(name: str) -> Study:
    """The study called `name`; ConfigurationError for another name."""
    if name not in studies():
        raise ConfigurationError(f"study: {name!r} is not known; known: {', '.join(studies())}")
    return studies()[name]
