"""Optional libraries: what needs them, whether they are installed, how to install
them.
"""

import re
import sys
from collections.abc import Iterable, Mapping
from importlib.metadata import PackageNotFoundError, requires
from importlib.util import find_spec
from types import MappingProxyType

from drivers.base.errors import ConfigurationError

EXTRA = re.compile(r"extra == ['\"](\w+)")
FEATURES: Mapping[str, str] = MappingProxyType(
    {
        "pylibfranka": "arm 'fci' (Linux x86_64, Python 3.11 or 3.12)",
        "distributed": "--cluster",
        "mcap": "an MCAP file",
        "cmaes": "`cell train`",
        "torch": "`cell train --policy adaptive`",
    }
)


def require_library(module: str) -> None:
    """Raise ConfigurationError where the optional library `module` is not installed."""
    if find_spec(module) is None:
        raise missing_library(module)


def missing_library(module: str) -> ConfigurationError:
    """Error for the missing library `module`: what needs it, and how to install it
    here.
    """
    return ConfigurationError(
        f"{FEATURES[module]} needs the library {module}, which is not installed here;"
        f" install it with `{pip_line([module])}`"
    )


def missing_features() -> Mapping[str, str]:
    """Optional libraries that are not installed, each with what needs it."""
    return {
        module: use for module, use in FEATURES.items() if find_spec(module) is None
    }


def pip_line(modules: Iterable[str]) -> str:
    """Command line that installs the optional libraries `modules` here."""
    wanted = dict.fromkeys(each for module in modules for each in _requirements(module))
    return f"{sys.executable} -m pip install {' '.join(map(repr, wanted))}"


def _requirements(module: str) -> list[str]:
    """Libraries, with version ranges, of the optional feature that needs `module`."""
    try:
        lines = [line.partition(";") for line in requires("folding-cell") or []]
    except PackageNotFoundError:
        lines = []
    stated = [(library.strip(), EXTRA.findall(marker)) for library, _, marker in lines]
    optional = [
        (library, extra) for library, extra in stated if extra and extra != ["test"]
    ]
    is_module = re.compile(rf"{module}(?![\w-])").match
    own_extra = next((extra for library, extra in optional if is_module(library)), None)
    return [library for library, extra in optional if extra == own_extra] or [module]
