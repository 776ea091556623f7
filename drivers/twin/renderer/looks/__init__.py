"""Registry of looks, the visual appearances of the cell: `LOOK` of each module in this folder."""

import importlib
import pkgutil
from collections.abc import Mapping
from functools import cache

from drivers.twin.renderer.looks.look import Look

DEFAULT_LOOK = "green-mat"


@cache
def looks() -> Mapping[str, Look]:
    """All looks by name, the default look first."""
    modules = [name for _, name, _ in pkgutil.iter_modules(__path__) if name != "look"]
    found = [importlib.import_module(f"{__name__}.{name}").LOOK for name in modules]
    return {
        look.name: look for look in sorted(found, key=lambda it: (it.name != DEFAULT_LOOK, it.name))
    }


def check_look(name: str) -> str:
    """Returns `name` if a look has it; raises ValueError with all names otherwise."""
    if name not in looks():
        raise ValueError(f"there is no look {name!r}; allowed: {', '.join(looks())}")
    return name
