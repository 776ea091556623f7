"""Why a run is being stopped."""

from dataclasses import dataclass
from typing import Self

from drivers.errors import CellError, Fault, PreflightRefused


@dataclass(frozen=True, slots=True)
class Stopped:
    """Why a run is being stopped, and what the command line then returns."""

    name: str
    reason: str
    exit_code: int

    @classmethod
    def by(cls, error: Exception) -> Self:
        """The stop that an error asks for; one that nobody expected is an `internal_error`."""
        if isinstance(error, Fault):
            return cls(error.name, error.reason, error.exit_code)
        if isinstance(error, CellError):
            name = "preflight_refused" if isinstance(error, PreflightRefused) else "error"
            return cls(name, str(error), error.exit_code)
        return cls("internal_error", f"{type(error).__name__}: {error}", Fault.exit_code)


INTERRUPTED = Stopped("interrupted", "stopped from the keyboard", 130)
INTERRUPTED_AT_ONCE = Stopped("interrupted", "stopped at once from the keyboard", 130)
