"""Registry of studies: finds the `STUDY` of every module in this folder."""

import importlib
import pkgutil
from collections.abc import Mapping
from functools import cache

from drivers.base.errors import ConfigurationError, suggestion
from tests.lab.studies.study import Study


@cache
def studies() -> Mapping[str, Study]:
    """Studies by name, sorted."""
    names = (name for _, name, _ in pkgutil.iter_modules(__path__, f"{__name__}."))
    found = (
        m.STUDY for m in map(importlib.import_module, names) if hasattr(m, "STUDY")
    )
    return {study.name: study for study in sorted(found, key=lambda study: study.name)}


def study_of(name: str) -> Study:
    """Study called `name`; raises ConfigurationError for an unknown name."""
    if name not in studies():
        raise ConfigurationError(
            f"study: {name!r} is not known{suggestion(name, studies())}; known: "
            f"{', '.join(studies())}"
        )
    return studies()[name]
