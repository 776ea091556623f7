"""Opens the subject, strip or mechanism, that a file describes, with its measured
runs.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from cell.gap.subject.run_folders import RunFolder
from cell.gap.subject.subject import Subject
from drivers.base.errors import ConfigurationError
from drivers.base.readers import read_yaml

if TYPE_CHECKING:
    from cell.gap.subject.mechanism.subject import MechanismSubject


def open_subject(
    file: Path, runs: Sequence[RunFolder], jobs: int, without: Sequence[str] = ()
) -> Subject:
    """Strip or mechanism of `file` with its measured runs; `without` names withheld
    effects.

    Raises ConfigurationError for a file of another kind, or an effect that cannot be
    withheld.
    """
    kind = read_yaml(file).get("kind", "strip")
    if kind == "strip":
        from cell.gap.subject.strip.subject import open_strip

        return open_strip(file, runs, jobs, without)
    if kind == "mechanism":
        return open_mechanism(file, runs, jobs, without)
    allowed = "strip, mechanism (a pendulum is one of mode planar: configs/mechanisms)"
    raise ConfigurationError(f"{file}: kind: is {kind!r}; allowed: {allowed}")


def open_mechanism(
    path: Path,
    folders: Sequence[RunFolder],
    jobs: int = 1,
    without: Sequence[str] = (),
    model: Path | None = None,
) -> "MechanismSubject":
    """Mechanism of the file at `path` with its measured runs; `without` names withheld
    effects, another `model` stands for the file's with its effects.

    Raises ConfigurationError for bad input, and where the stated model itself cannot be
    simulated.
    """
    from cell.gap.subject.mechanism.cell_arm import CellArm
    from cell.gap.subject.mechanism.forward_dynamics import ForwardDynamics
    from cell.gap.subject.mechanism.inverse_dynamics import InverseDynamics
    from cell.gap.subject.mechanism.read_mechanism import open_all

    mechanism = open_all(path, folders, model)
    along_motion = CellArm if mechanism.file.cell else InverseDynamics
    engine = along_motion if mechanism.file.mode == "prescribed" else ForwardDynamics
    subject = engine(mechanism, jobs, without)
    subject.check(str(path))
    return subject
