"""Pendulum files read and checked."""

from pathlib import Path

from cell.gap.subject.pendulum.file import PendulumFile
from cell.gap.subject.pendulum.scope import check_effects
from drivers.settings import load


def load_pendulum(path: Path) -> PendulumFile:
    """Read the pendulum file at `path`.

    Raises ConfigurationError where it is broken, or names an effect that the library lacks.
    """
    pendulum = load(path, PendulumFile)
    check_effects(pendulum, str(path))
    return pendulum
