"""Writing of a measurement: a folder with pictures and numbers, and the strip's file."""

import json
from datetime import date
from pathlib import Path

from cell.record.documents import plain
from cell.strips.edit import with_measured
from cell.strips.measurement import Measurement
from cell.strips.picture import picture
from drivers.files import change_file, replace_file, writing
from drivers.settings import parse
from drivers.strip.file import StripFile
from drivers.yaml_text import edit_yaml, parse_yaml

MEASUREMENT_FILE = "measurement.json"


def save(measurement: Measurement, folder: Path) -> None:
    """Write a picture for each photograph and then the numbers into `folder`.

    Raises ConfigurationError where the folder cannot be written.
    """
    bending = measurement.bending
    pairs = zip(bending.fits, bending.straight, strict=True)
    pictures = {
        f"{index:02d}-{fit.photograph.name}.png": picture(fit, straight)
        for index, (fit, straight) in enumerate(pairs, start=1)
    }
    numbers = json.dumps(plain(measurement.line()), indent=1, ensure_ascii=False) + "\n"
    with writing(f"--out: {folder}"):
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in pictures.items():
            replace_file(folder / name, content)
        replace_file(folder / MEASUREMENT_FILE, numbers.encode())


def put_into(path: Path, measurement: Measurement, today: date) -> None:
    """Write the measured bending length into the strip file at `path`, with its provenance."""
    pooled = measurement.bending_length
    overhangs = sorted({each.photograph.overhang for each in measurement.bending.fits})
    count = len(measurement.bending.fits)
    source = (
        f"cantilever test, {count} photograph{'s' * (count > 1)} at overhangs of "
        f"{', '.join(f'{each:g}' for each in overhangs)} m, measured {today.isoformat()}"
    )
    note = (
        f"95 % between {pooled.low:.4g} and {pooled.high:.4g} m; "
        f"born {measurement.bending.prior.kind.value}; some yarn friction is in it"
    )

    def change(text: str) -> str:
        content = parse_yaml(text, str(path))
        content = with_measured(content, "bending_length", measurement.value, source, note)
        parse(content, StripFile, str(path))
        return edit_yaml(text, content)

    change_file(path, change)
