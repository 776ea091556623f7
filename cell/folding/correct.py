"""Corrects folds by biases learned from earlier ones, and updates these from new folds."""

from dataclasses import replace

from cell.config.cell import CellFile
from cell.config.length import metres
from cell.devices.open import is_physical
from cell.folding.fold import Request
from cell.learning.correction import Correction, learned_correction, subject_of
from cell.learning.experience import Memory

WORDS = ("auto", "on", "off")


def with_correction(request: Request, learning: str | None) -> Request:
    """Copy of `request` with the correction for its fold, and with the choice to learn from it.

    `learning` is `auto`, `on`, `off`, a length to correct by without learning, or None for the
    cell's own setting. Raises ConfigurationError for other text.
    """
    settings, strip = request.read_files()
    if learning is not None and learning not in WORDS:
        bias = metres("--learning", learning, settings.learning.limit)
        return replace(request, correction=Correction(bias, 0.0), learns=False)
    memory = Memory(settings.name, request.memory, twin=not is_physical(settings, request.choice))
    if not _should_learn(settings, request, learning, memory):
        return replace(request, correction=Correction(0.0, 0.0), learns=False)
    subject = subject_of(request.policy, request.checkpoint, strip.name, request.specimen)
    found = learned_correction(memory, subject, settings.learning)
    return replace(request, correction=found, learns=True)


def _should_learn(
    settings: CellFile, request: Request, learning: str | None, memory: Memory
) -> bool:
    if learning in {"on", "off"}:
        return learning == "on"
    if memory.is_off or settings.learning.use == "off":
        return False
    on = settings.learning.use == "on" and learning != "auto"
    return on or is_physical(settings, request.choice)
