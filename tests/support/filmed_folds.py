"""Folds on the twin with a film as a separate camera's recorder writes it."""

from pathlib import Path

from cell.folding.fold import fold
from cell.orchestrator.snapshot import Snapshot
from cell.record.film import Film, FilmWriter
from cell.record.run import Run, read_run
from cell.setup.calibration_in_use import calibration_of
from tests.support.requests import request_for


class Filming:
    """Observer that writes every new image of a fold into a film."""

    def __init__(self, writer: FilmWriter) -> None:
        self._writer = writer
        self.begin: float | None = None

    def handle_tick(self, snapshot: Snapshot) -> None:
        frame = snapshot.view.frame
        if snapshot.view.fresh and frame is not None:
            self.begin = frame.stamp if self.begin is None else self.begin
            self._writer.add(frame.stamp, frame.image)

    def handle_event(self, time: float, kind: str, facts: dict[str, object]) -> None:
        """Nothing to write."""


def filmed(strip: str, policy: str, place: Path) -> tuple[Run, Path, float]:
    """Run of a fold, its film, and the film's start on the run's clock [s]."""
    film = place / "fold.mkv"
    with FilmWriter(film) as writer:
        filming = Filming(writer)
        request = request_for(strip, policy, place / "runs")
        result = fold(request, calibration_of(request.cell), (filming,))
    run = read_run(Path(result.run))
    assert filming.begin is not None
    return run, film, filming.begin - run.origin()


def encoded_again(film: Path, encoder: str) -> Path:
    """Copy of the film by another encoder."""
    again = film.with_name(f"{encoder}.mkv")
    with FilmWriter(again, encoder) as writer:
        for frame in Film(film).frames():
            writer.add(frame.stamp, frame.image)
    return again
