"""Opens a mechanism's file and its measured runs as a subject of the gap workflow."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from cell.gap.subject.mechanism.cell_arm import CellArm
from cell.gap.subject.mechanism.forward_dynamics import ForwardDynamics
from cell.gap.subject.mechanism.inverse_dynamics import InverseDynamics
from cell.gap.subject.mechanism.load import open_all
from cell.gap.subject.mechanism.pendulum import Pendulum, open_swings
from cell.gap.subject.mechanism.subject import MechanismSubject
from cell.gap.subject.run_folders import RunFolder
from drivers.readers import read_yaml

MODES: Mapping[str, type[ForwardDynamics | InverseDynamics]] = {
    "forward": ForwardDynamics, "prescribed": InverseDynamics,
}  # fmt: skip


def open_mechanism(
    path: Path, folders: Sequence[RunFolder], jobs: int = 1, without: Sequence[str] = ()
) -> MechanismSubject:
    """Read a mechanism's file and measured runs, and check them; effects `without` are withheld.

    Raises ConfigurationError for bad input, and where the stated model itself cannot be simulated.
    """
    if read_yaml(path).get("kind") == "pendulum":  # steps by its fastest swing, whatever its values
        return Pendulum(open_swings(path, folders), jobs, without)
    opened = open_all(path, folders)
    kind = CellArm if opened.file.cell else MODES[opened.file.mode]
    subject = kind(opened, jobs, without)
    subject.check(str(path))
    return subject
