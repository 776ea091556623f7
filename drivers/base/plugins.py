"""Plug-ins: objects that other installed packages provide by an entry point."""

from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from importlib.metadata import EntryPoint, entry_points
from typing import TypeVar

from drivers.base.errors import CellError, ConfigurationError

T = TypeVar("T")
# before a dot and the kind, such as effects, policies, arms, cameras
GROUP = "folding_cell"


def plugin_names(kind: str) -> tuple[str, ...]:
    """Sorted names of the installed plug-ins of `kind`, such as policies; none is
    imported.
    """
    return tuple(sorted(point.name for point in entry_points(group=f"{GROUP}.{kind}")))


def plugins(kind: str, of: type[T], taken: Collection[str]) -> Mapping[str, T]:
    """Import the installed plug-ins of `kind`, by name; they must be instances of class
    `of`.

    Raises ConfigurationError for one that cannot be imported, is not an `of`, or has a
    name in `taken`.
    """
    loaded: dict[str, T] = {}
    for point in sorted(
        entry_points(group=f"{GROUP}.{kind}"), key=lambda point: point.name
    ):
        if point.name in taken or point.name in loaded:
            raise ConfigurationError(
                f"{_origin_of(point)}: this name is taken; choose another one"
            )
        loaded[point.name] = _load(point, of)
    return loaded


@contextmanager
def guarded(kind: str, name: str) -> Iterator[None]:
    """Context that turns an error of the plug-in `name` into one that names its
    package.

    Any exception but a CellError, and an exit, becomes a ConfigurationError; without a
    plug-in of that name they pass unchanged.
    """
    points = entry_points(group=f"{GROUP}.{kind}", name=name)
    try:
        yield
    except CellError:
        raise
    except (Exception, SystemExit) as error:
        if not points:
            raise
        raise _failure(next(iter(points)), "fails", error) from error


def _load(point: EntryPoint, of: type[T]) -> T:
    """Import the plug-in at `point`; ConfigurationError where it fails or is not an
    `of`.
    """
    try:
        value = point.load()
    except (Exception, SystemExit) as error:
        raise _failure(point, "cannot be imported", error) from error
    if not isinstance(value, of):
        raise ConfigurationError(
            f"{_origin_of(point)}: {point.value} is of {type(value).__name__}, must be"
            f" of {of.__name__}"
        )
    return value


def _failure(point: EntryPoint, what: str, error: BaseException) -> ConfigurationError:
    text = str(error)
    if not isinstance(error, ImportError):
        text = f"{type(error).__name__}: {text}"
    return ConfigurationError(
        f"{_origin_of(point)}: {point.value} {what}: {text}; mend or uninstall it"
    )


def _origin_of(point: EntryPoint) -> str:
    package = "" if point.dist is None else f" of package {point.dist.name}"
    return f"plug-in {point.group}: {point.name}{package}"
