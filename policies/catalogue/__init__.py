"""Registry of policies: the `ENTRY` of every module of this folder, and plug-ins of that kind."""

import importlib
import pkgutil
from collections.abc import Mapping
from functools import cache

from drivers.plugins import plugins
from policies.catalogue.entry import Entry


@cache
def entries() -> Mapping[str, Entry]:
    """Registry entries by name of the policy, that of its module, in display order."""
    names = [name for _, name, _ in pkgutil.iter_modules(__path__) if name != "entry"]
    found = {name: importlib.import_module(f"{__name__}.{name}").ENTRY for name in names}
    found |= plugins("policies", Entry, found)
    return dict(sorted(found.items(), key=lambda item: (item[1].rank, item[0])))
