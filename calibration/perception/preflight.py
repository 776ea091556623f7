"""One picture before grasping: does the right strip lie there, flat and well visible?"""

from dataclasses import dataclass

from calibration.calibration import Calibration
from calibration.perception.appearance import Appearance
from calibration.perception.settings import PerceptionSettings
from drivers.strip.file import StripFile
from drivers.types import Frame


@dataclass(frozen=True, slots=True)
class PreflightCheck:
    """One named check: what was found, and what to do when it failed."""

    name: str
    passed: bool
    reason: str
    remedy: str


@dataclass(frozen=True, slots=True)
class Preflight:
    """All checks of one picture, and how things look; `appearance` is None without a strip."""

    checks: tuple[PreflightCheck, ...]
    appearance: Appearance | None

    @property
    def passed(self) -> bool:
        """Whether every check passed."""
        return self.appearance is not None and all(check.passed for check in self.checks)


def inspect(
    frame: Frame, calibration: Calibration, settings: PerceptionSettings, strip: StripFile
) -> Preflight:
    """Checks of the picture `frame` of a strip lying flat on the desk, not yet grasped."""
    raise NotImplementedError
