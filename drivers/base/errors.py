"""Expected errors of the cell: one root class, one exit code each."""

import traceback
from collections.abc import Collection, Iterable
from difflib import get_close_matches
from pathlib import Path
from typing import Any


class CellError(Exception):
    """Root class of all expected errors; `exit_code` is the command line's exit code
    for it.

    Can be pickled between processes, whatever arguments its constructor has.
    """

    exit_code = 1

    def __reduce__(self) -> tuple[Any, ...]:
        return _rebuild, (type(self), self.args), self.__dict__


class ConfigurationError(CellError):
    """Error for an unusable file, key or argument; its text is `file: key: problem;
    remedy`.
    """

    exit_code = 2


class PreflightRefused(CellError):
    """Error for a failed check before the motion; nothing has moved."""

    exit_code = 3


class Fault(CellError):
    """Error that stops a run, by a monitor, driver or simulation; its `name` is
    recorded.
    """

    exit_code = 4

    def __init__(self, name: str, reason: str) -> None:
        super().__init__(f"{name}: {reason}")
        self.name = name
        self.reason = reason


class SimulationNotFinite(Fault):
    """Fault of a simulated strip that diverged, because of its model or time step."""

    def __init__(self, engine: str, time: float) -> None:
        super().__init__(
            "simulation_not_finite",
            f"the {engine} diverged at {time:.3f} s; "
            "use more damping, a smaller step or slower motion",
        )


class SimulationNotConverged(Fault):
    """Fault of an implicit solver that found no shape of a strip for the next time
    step.
    """

    def __init__(self, engine: str, strip: int, time: float) -> None:
        super().__init__(
            "simulation_not_converged",
            f"the {engine} found no shape of strip {strip} at {time:.3f} s; "
            "use a smaller step, more damping or slower motion",
        )


class Unsupported(CellError):
    """Error for a part of a strip's description that an engine cannot simulate."""

    exit_code = 2

    def __init__(self, engine: str, part: str) -> None:
        super().__init__(f"the {engine} cannot simulate {part}; use the other engine")


def in_mm(length: float, decimals: int = 0) -> str:
    """Text of a `length` [m] in mm, as refusals and lines for operators state it."""
    return f"{1e3 * length:.{decimals}f} mm"


def in_ms(time: float) -> str:
    """Text of a `time` [s] in whole ms."""
    return f"{1e3 * time:.0f} ms"


def in_percent(share: float) -> str:
    """Text of a `share` in whole per cent."""
    return f"{100 * share:.0f} %"


def suggestion(name: str, known: Iterable[str]) -> str:
    """Text ` (did you mean ...?)` with the `known` name closest to `name`; empty for
    none close.
    """
    names = list(known)
    same_letters = [each for each in names if sorted(each) == sorted(name)]
    alike = get_close_matches(name, names, n=len(names) or 1)
    nearest = min(
        [*same_letters, *alike],
        key=lambda each: _typing_errors(name, each),
        default=None,
    )
    return "" if nearest is None else f" (did you mean {nearest!r}?)"


def _typing_errors(typed: str, meant: str) -> int:
    """Least number of letters left out, added, replaced, or swapped with the next
    (Damerau).

    No letter is changed twice, which makes it the optimal string alignment.
    """
    before = list[int]()
    last = list(range(len(meant) + 1))
    for i, letter in enumerate(typed, start=1):
        row = [i]
        for j, other in enumerate(meant, start=1):
            replaced = last[j - 1] + (letter != other)
            least = min(replaced, last[j] + 1, row[j - 1] + 1)
            if i > 1 and j > 1 and (typed[i - 2], letter) == (other, meant[j - 2]):
                least = min(least, before[j - 2] + 1)
            row.append(least)
        before, last = last, row
    return last[-1]


def check_known(what: str, name: str, known: Collection[str]) -> None:
    """Raise ConfigurationError, with all `known` names, for a `name` of `what` that is
    unknown.
    """
    if name not in known:
        raise ConfigurationError(
            f"{what}: unknown name {name!r}{suggestion(name, known)}; "
            f"allowed: {', '.join(known) or 'none'}"
        )


def _rebuild(kind: type[CellError], arguments: tuple[Any, ...]) -> CellError:
    error = kind.__new__(kind)
    error.args = arguments
    return error


class Unexpected(CellError):
    """Error for a defect of this program: an exception that was not expected, and its
    place.
    """

    def __init__(self, error: BaseException) -> None:
        frame = traceback.extract_tb(error.__traceback__)[-1]
        text = " ".join(str(error).split()) or "no reason given"
        super().__init__(
            f"unexpected {type(error).__name__} in {Path(frame.filename).name}, line "
            f"{frame.lineno}: {text}; this is a defect of the program, please report it"
        )


class WorkersLost(CellError):
    """Error for worker processes that died; finished parts of the work stay in the
    journal.
    """

    def __init__(self, reason: str) -> None:
        super().__init__(f"{reason}; run the same command again to go on")
