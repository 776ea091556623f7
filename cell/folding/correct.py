"""Corrects folds by biases learned from earlier ones, and updates these from new folds."""

from dataclasses import replace
from pathlib import Path

from cell.config.cell import CellFile
from cell.config.length import metres
from cell.devices.open import is_real, real_camera
from cell.folding.fold import Request
from cell.learning.correction import Correction, learned_correction, subject_of
from cell.learning.experience import Experience, Memory, ruler_experience

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
    memory = Memory(settings.name, request.memory)
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
    return on or is_real(settings, request.choice) or real_camera(settings, request.choice)


def learn_from_ruler(run: Path, edges: float, cell: str, folder: Path | None = None) -> Experience:
    """Learn the bias of `cell` from a ruler's reading: the edges of `run` lie `edges` [m] apart.

    `folder` as in `Memory`. Raises ConfigurationError as `ruler_experience` does, and where nothing
    can be kept.
    """
    memory = Memory(cell, folder)
    experience = ruler_experience(run, edges, memory)
    memory.add(experience)
    return experience
