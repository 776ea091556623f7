"""Optional libraries: what needs them, whether they are installed, how to install
them.
"""

import sys
from collections.abc import Iterable, Mapping
from importlib.util import find_spec
from pathlib import Path
from shlex import quote
from types import MappingProxyType

from drivers.base.errors import ConfigurationError

CONSTRAINTS = ".ci/constraints.txt"  # versions that are tested together
CPU_BUILD = (
    "install PyTorch's CPU build first, as its maker's selector says (pip alone takes"
    " gigabytes of CUDA), then run "
)
FEATURES: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "pylibfranka": ("fci", "arm 'fci' (Linux x86_64, Python 3.11 or 3.12)"),
        "distributed": ("cluster", "--cluster"),
        "mcap": ("mcap", "an MCAP file"),
        "cmaes": ("train", "`cell train`"),
        "torch": ("train", "`cell train --policy adaptive`"),
    }
)
"""Extra that brings each optional library, and what needs it."""


def require_library(module: str) -> None:
    """Raise ConfigurationError where the optional library `module` is not installed."""
    if find_spec(module) is None:
        raise missing_library(module)


def missing_library(module: str) -> ConfigurationError:
    """Error for the missing library `module`: what needs it, and how to install it
    here.
    """
    return ConfigurationError(
        f"{FEATURES[module][1]} needs the library {module}, which is not installed"
        f" here; {install_advice(module)}"
    )


def missing_features() -> Mapping[str, str]:
    """Optional libraries that are not installed, each with what needs it."""
    return {
        module: use
        for module, (_, use) in FEATURES.items()
        if find_spec(module) is None
    }


def install_advice(module: str) -> str:
    """Words that say how to install the optional library `module` with its extra."""
    first = CPU_BUILD if module == "torch" else "install it with "
    return f"{first}`{sys.executable} -m {install_line([FEATURES[module][0]])}`"


def install_line(extras: Iterable[str] = ()) -> str:
    """Arguments of pip that install the cell with `extras`, from its checkout if it
    runs in one.

    In a checkout the versions are those that are tested together.
    """
    root = Path(__file__).resolve().parents[2]
    names = ",".join(extras)
    suffix = f"[{names}]" if names else ""
    if not (root / CONSTRAINTS).is_file():
        return f"pip install {quote(f'folding-cell{suffix}')}"
    constraints = quote(str(root / CONSTRAINTS))
    return f"pip install -c {constraints} -e {quote(f'{root}{suffix}')}"
