"""A fold on the twin, and a film of it as another camera's recorder would write it."""

from pathlib import Path

from cell.calibrate.calibration_in_use import calibration_of
from cell.folding.fold import fold
from cell.orchestrator.snapshot import Snapshot
from cell.record.film import Film, FilmWriter
from cell.record.run import Run, read_run
from tests.support.requests import request_for


class Filming:
    """Writes every fresh image of a fold into a film."""

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
    """The run, its film, and when on the run's clock the film begins [s]."""
    film = place / "fold.mkv"
    with FilmWriter(film) as writer:
        filming = Filming(writer)
        request = request_for(strip, policy, place / "runs")
        result = fold(request, calibration_of(request.cell), (filming,))
    run = read_run(Path(result.run))
    assert filming.begin is not None
    return run, film, filming.begin - run.origin()


def encoded_again(film: Path, encoder: str) -> Path:
    """The film once more, by another encoder."""
    again = film.with_name(f"{encoder}.mkv")
    with FilmWriter(again, encoder) as writer:
        for frame in Film(film).frames():
            writer.add(frame.stamp, frame.image)
    return again
