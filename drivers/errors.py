"""Expected errors of the cell: one root class, one exit code each."""

import traceback
from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path
from typing import Any


class CellError(Exception):
    """Root of every expected error; `exit_code` is what the command line returns for it.

    Can be pickled between processes, whatever its constructor takes.
    """

    exit_code = 1

    def __reduce__(self) -> tuple[Any, ...]:
        return _rebuild, (type(self), self.args), self.__dict__


class ConfigurationError(CellError):
    """A file, key or argument that cannot be used; its text is `file: key: what, allowed`."""

    exit_code = 2


class PreflightRefused(CellError):
    """A check before the motion failed; nothing has moved."""

    exit_code = 3


class Fault(CellError):
    """The run was stopped by a monitor, a driver or the plant; `name` goes into the record."""

    exit_code = 4

    def __init__(self, name: str, reason: str) -> None:
        super().__init__(f"{name}: {reason}")
        self.name = name
        self.reason = reason


class SimulationNotFinite(Fault):
    """The simulated strip diverged: caused by model and time step, not by the controller."""

    def __init__(self, engine: str, time: float) -> None:
        super().__init__(
            "simulation_not_finite",
            f"the {engine} diverged at {time:.3f} s; "
            "use more damping, a smaller step or slower motion",
        )


class SimulationNotConverged(Fault):
    """The implicit solver found no equilibrium shape for the next time step."""

    def __init__(self, engine: str, strip: int, time: float) -> None:
        super().__init__(
            "simulation_not_converged",
            f"the {engine} found no shape of strip {strip} at {time:.3f} s; "
            "use a smaller step, more damping or slower motion",
        )


class Unsupported(CellError):
    """An engine cannot simulate a part of the strip's description."""

    exit_code = 2

    def __init__(self, engine: str, part: str) -> None:
        super().__init__(f"the {engine} cannot simulate {part}; use the other engine")


def suggestion(name: str, known: Iterable[str]) -> str:
    """Hint in an error message at the `known` name closest to `name`; empty where none is close."""
    near = get_close_matches(name, list(known), n=1)
    return f" (did you mean {near[0]!r}?)" if near else ""


def _rebuild(kind: type[CellError], arguments: tuple[Any, ...]) -> CellError:
    error = kind.__new__(kind)
    error.args = arguments
    return error


class Unexpected(CellError):
    """A defect of this program, reported with its place in the source and its message."""

    def __init__(self, error: BaseException) -> None:
        place = traceback.extract_tb(error.__traceback__)[-1]
        text = " ".join(str(error).split()) or "no reason given"
        super().__init__(
            f"unexpected {type(error).__name__} in {Path(place.filename).name}, line "
            f"{place.lineno}: {text}; this is a defect of the program, please report it"
        )


class WorkersLost(CellError):
    """The worker processes died; the journal keeps all finished parts of the work."""

    def __init__(self, reason: str) -> None:
        super().__init__(f"{reason}; run the same command again to go on")
