"""Opens the subject that a file describes, with its measured runs."""

from collections.abc import Sequence
from pathlib import Path

from cell.gap.subject.run_folders import RunFolder
from cell.gap.subject.subject import Subject
from drivers.errors import ConfigurationError
from drivers.readers import read_yaml


def open_subject(
    file: Path, runs: Sequence[RunFolder], jobs: int, without: Sequence[str] = ()
) -> Subject:
    """Open the subject that `file` describes with its runs; effects `without` are withheld.

    Raises ConfigurationError for a file of another kind, or an effect that cannot be withheld.
    """
    kind = read_yaml(file).get("kind", "strip")
    if kind == "strip":
        from cell.gap.subject.strip.subject import open_strip

        subject: Subject = open_strip(file, runs, jobs, without)
    elif kind in ("pendulum", "mechanism"):
        from cell.gap.subject.mechanism.open_mechanism import open_mechanism

        subject = open_mechanism(file, runs, jobs, without)
    else:
        raise ConfigurationError(f"{file}: kind: is {kind!r}; allowed: strip, pendulum, mechanism")
    subject.option = option_for(file)
    return subject


def option_for(file: Path) -> str:
    """Option by which every command of the gap takes the strip or mechanism in `file`."""
    content = read_yaml(file)
    if content.get("cell"):  # the cell's own, whose effects may belong into its file
        return f"--subject {file.parent.name}"
    return f"--{'strip' if content.get('kind', 'strip') == 'strip' else 'model'} {file}"
