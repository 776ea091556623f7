"""The film of a run: every image at its own time, whatever befalls process or
encoder.
"""

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from cell.record.files import FILM
from cell.record.film import Film, FilmProcess, FilmWriter
from cell.record.frames import QUEUE, read_index
from cell.record.run import read_run
from cell.record.writer import RunWriter
from drivers.base.errors import ConfigurationError
from drivers.base.types import Frame
from tests.cell.conftest import HEADER
from tests.support.children import children, holds
from tests.support.refusals import refusal

IMAGES, TICK = 70, 1 / 90_000


def image(sequence: int) -> np.ndarray:
    return np.full((64, 96, 3), 3 * sequence % 256, np.uint8)


def frame(sequence: int) -> Frame:
    """A camera that takes its images at uneven times, the first before the lift."""
    stamp = 0.06 * sequence + 0.01 * (sequence % 3) - 0.2
    return Frame(stamp, stamp + 0.02, "made", sequence, image(sequence))


def shown(root: Path) -> int:
    """How many images the film of the run in `root` shows by now."""
    films = list(root.glob(f"*/{FILM}"))
    try:
        return sum(1 for film in films for _ in Film(film).frames())
    except ConfigurationError:
        return 0


def filmed_well(root: Path) -> bool:
    """Whether the run in `root` has all its images, and its film all but the last of
    those that found room in it.
    """
    try:
        notes = [note for folder in root.iterdir() for note in read_index(folder)]
    except ConfigurationError:  # a line is being written
        return False
    kept = sum(note.film is not None for note in notes)
    return len(notes) == IMAGES and shown(root) >= kept - 3


@pytest.mark.parametrize("patient", [True, False])
def test_killed_process_leaves_a_film_up_to_its_last_images(tmp_path, patient):
    script = f"""
import time
from pathlib import Path
from cell.record.writer import RunWriter
from tests.cell.record.test_run_film import frame
root = Path({str(tmp_path)!r})
writer = RunWriter(root, {HEADER!r}, "none", patient={patient}, film="libx264")
for sequence in range({IMAGES}):
    writer.frame(frame(sequence))
    time.sleep({0 if patient else 0.02})
time.sleep(600)
"""
    with subprocess.Popen([sys.executable, "-c", script]) as process:
        recorded = holds(lambda: filmed_well(tmp_path))
        process.send_signal(signal.SIGKILL)
    assert recorded
    (folder,) = tmp_path.iterdir()
    run = read_run(folder)
    assert run.died
    # a process of its own ends its film first
    assert holds(lambda: filmed_well(tmp_path))
    if patient:
        assert all(note.film is not None for note in run.frame_index())


def test_encoder_that_lags_loses_images_of_the_film_and_of_nothing_else(
    tmp_path, monkeypatch
):
    add, gate = FilmWriter.add, threading.Event()
    monkeypatch.setattr(
        FilmWriter, "add", lambda *arguments: gate.wait() and add(*arguments)
    )
    monkeypatch.setattr("cell.record.film.FilmProcess", FilmWriter)
    writer = RunWriter(tmp_path, HEADER, "all", patient=False, film="libx264")
    for sequence in range(QUEUE):
        writer.frame(frame(sequence))
    gate.set()
    writer.finish({"outcome": "path_done"})
    run = read_run(writer.folder)
    notes = run.frame_index()
    assert len(notes) == QUEUE == sum(note.file is not None for note in notes)
    kept = [note for note in notes if note.film is not None]
    assert [note.film for note in kept] == list(range(len(kept)))
    assert 1 < len(kept) <= QUEUE // 2 + 2
    pictures = Film(run.folder / FILM).frames()
    assert [picture.stamp for picture in pictures] == pytest.approx(
        [note.stamp - kept[0].stamp for note in kept], abs=TICK
    )


def test_film_of_another_process_holds_every_image_at_its_own_time(tmp_path):
    path = tmp_path / FILM
    with FilmProcess(path, "libx264") as film:
        for sequence in range(IMAGES):
            film.add(frame(sequence).stamp, image(sequence))
    pictures = list(Film(path).frames())
    stamps = [frame(sequence).stamp - frame(0).stamp for sequence in range(IMAGES)]
    assert [picture.stamp for picture in pictures] == pytest.approx(stamps, abs=TICK)
    for sequence, picture in enumerate(pictures):
        assert abs(picture.image.mean() - image(sequence).mean()) < 4


@pytest.mark.parametrize(
    ("sent", "images", "words"),
    [
        (signal.SIGKILL, IMAGES, "the film breaks off"),
        (signal.SIGSTOP, QUEUE, "its encoder hangs"),
    ],
)
def test_film_whose_encoder_dies_or_hangs_ends_and_not_the_run(
    sent, images, words, tmp_path, monkeypatch
):
    writer = RunWriter(tmp_path, HEADER, "none", patient=False, film="libx264")
    monkeypatch.setattr("cell.record.film.ENCODER_TIMEOUT", 0.2)
    (process,) = children("film")
    os.kill(process, sent)
    for sequence in range(images):
        writer.frame(frame(sequence))
    writer.finish({"outcome": "path_done"})
    run = read_run(writer.folder)
    assert run.result.outcome == "path_done"
    assert len(run.frame_index()) == images
    assert words in run.header.model_extra["film"]


def test_what_is_no_film_is_refused_in_words(tmp_path):
    (tmp_path / "text.mp4").write_text("no film")
    for name, said in (
        ("", "is a folder"),
        ("gone.mp4", "is not there"),
        ("text.mp4", "Invalid"),
    ):
        with refusal(said) as refused:
            next(Film(tmp_path / name).frames())
        assert "Errno" not in str(refused.value)
