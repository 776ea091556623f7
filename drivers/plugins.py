"""Plug-ins: objects that other installed packages add by an entry point of their own."""

from collections.abc import Collection, Mapping
from importlib.metadata import EntryPoint, entry_points
from typing import TypeVar

from drivers.errors import ConfigurationError

T = TypeVar("T")
GROUP = "folding_cell"  # before a dot and the kind, such as effects, policies, arms, cameras


def plugin_names(kind: str) -> tuple[str, ...]:
    """Names of the installed plug-ins of `kind`, sorted; none of them is imported."""
    return tuple(sorted(point.name for point in entry_points(group=f"{GROUP}.{kind}")))


def plugins(kind: str, of: type[T], taken: Collection[str]) -> Mapping[str, T]:
    """The installed plug-ins of `kind` by name, each an instance of `of`.

    Raises ConfigurationError for one that cannot be imported, is something else, or has a name that
    is `taken`.
    """
    found: dict[str, T] = {}
    for point in sorted(entry_points(group=f"{GROUP}.{kind}"), key=lambda point: point.name):
        if point.name in taken or point.name in found:
            raise ConfigurationError(f"{_origin_of(point)}: this name is taken; choose another one")
        found[point.name] = _load(point, of)
    return found


def _load(point: EntryPoint, of: type[T]) -> T:
    try:
        value = point.load()
    except (ImportError, AttributeError, SyntaxError) as error:
        raise ConfigurationError(
            f"{_origin_of(point)}: {point.value} cannot be imported: {error}; mend or uninstall it"
        ) from None
    if not isinstance(value, of):
        raise ConfigurationError(
            f"{_origin_of(point)}: {point.value} is of {type(value).__name__}, must be of "
            f"{of.__name__}"
        )
    return value


def _origin_of(point: EntryPoint) -> str:
    package = "" if point.dist is None else f" of package {point.dist.name}"
    return f"plug-in {point.group}: {point.name}{package}"
