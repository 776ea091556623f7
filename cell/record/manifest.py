"""Manifests: what a series of runs is, who makes it, and which of its parts are done.

A manifest is a file of JSON lines beside the runs. The first line states the series;
then a line follows when a part begins and when it ends. So a killed series loses no
part that had ended, and the process that makes it holds the file's lock.
"""

import fcntl
import os
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from cell.record.documents import json_line
from cell.record.files import MANIFEST
from drivers.base.errors import ConfigurationError
from drivers.base.files import append_line, new_file, write_all, writing
from drivers.base.readers import read_json_lines

DONE_CODES = {0, 1}  # exit codes of parts that need not be made again
Facts = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Manifest:
    """What a file notes on a series of `parts` runs: the kind of the series, digests of
    what it is made of, and which parts have begun and ended.

    `begun` has the number of each part that began, once for each time, and `ended` what
    is known of each part that ended, the last time counting.
    """

    path: Path
    kind: str
    name: str
    of: Mapping[str, str]
    parts: int
    process: int
    host: str
    begun: tuple[int, ...] = ()
    ended: Mapping[int, Facts] = field(default_factory=dict)
    is_over: bool = False

    @classmethod
    def read(cls, path: Path) -> "Manifest":
        """Content of the manifest at `path`; ConfigurationError where the file there is
        no manifest.
        """
        head, *lines = read_json_lines(path) or [{}]
        made_by = [head, *(line for line in lines if "process" in line)][-1]
        try:
            return cls(
                path=path,
                kind=str(head["kind"]),
                name=str(head["name"]),
                of={str(key): str(value) for key, value in head["of"].items()},
                parts=int(head["parts"]),
                process=int(made_by["process"]),
                host=str(made_by["host"]),
                begun=tuple(int(line["begin"]) for line in lines if "begin" in line),
                ended={int(line["end"]): line for line in lines if "end" in line},
                is_over=any("over" in line for line in lines),
            )
        except (KeyError, TypeError, ValueError, AttributeError):
            raise ConfigurationError(
                f"{path}: is no manifest of a series of runs; move it away"
            ) from None

    @property
    def done(self) -> frozenset[int]:
        """Numbers of those parts of the series that have ended, in a way that need not
        be repeated.
        """
        codes = {number: facts.get("exit_code") for number, facts in self.ended.items()}
        return frozenset(number for number, code in codes.items() if code in DONE_CODES)

    @property
    def is_complete(self) -> bool:
        """Whether no part of the series is left to be made, because all are done or the
        series was given up.
        """
        return self.is_over or len(self.done) >= self.parts

    @property
    def is_under_way(self) -> bool:
        """Whether a living process is still making the series, which its lock on the
        manifest shows.
        """
        with suppress(OSError), self.path.open("rb") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except BlockingIOError:
                return True
        return False

    def __str__(self) -> str:
        """Line of text on what the series is and how many of its parts are done."""
        under_way = f", under way (process {self.process} on {self.host})"
        return (
            f"{self.kind} of {self.name} in {self.path.parent}: {len(self.done)} of"
            f" {self.parts} done{under_way if self.is_under_way else ''}"
        )


def manifests_in(folder: Path) -> tuple[Manifest, ...]:
    """Manifests in `folder` and in its subfolders, in order of their names; other files
    are left out.
    """
    found = []
    for path in sorted([*folder.glob(f"*{MANIFEST}"), *folder.glob(f"*/{MANIFEST}")]):
        with suppress(ConfigurationError):
            found.append(Manifest.read(path))
    return tuple(found)


class RunSeries:
    """Series of runs that this process makes, and whose manifest it writes part by
    part.
    """

    def __init__(self, manifest: Manifest) -> None:
        self.manifest = manifest

    def begin(self, number: int) -> None:
        """Note in the manifest that the part with this `number` begins;
        ConfigurationError where that cannot be written.
        """
        self.note({"begin": number})

    def end(self, number: int, facts: Facts) -> None:
        """Note in the manifest that the part with this `number` has ended, with `facts`
        such as its exit code.
        """
        self.note({"end": number, **facts})

    def close(self) -> None:
        """Note in the manifest that the series is over, although some of its parts were
        never made.
        """
        self.note({"over": True})

    def way_on(self) -> str:
        """Sentence on how to go on with a series that is not complete; empty where it
        is complete.
        """
        now = Manifest.read(self.manifest.path)
        if now.is_complete:
            return ""
        return (
            f"{len(now.done)} of {now.parts} are done and kept; the same command with"
            " --resume goes on, and makes again what ended by a fault"
        )

    def note(self, line: Facts) -> None:
        """Append `line` to the manifest as JSON; ConfigurationError where that cannot
        be written.
        """
        with writing(self.manifest.path, "make room, then go on with --resume"):
            append_line(self.manifest.path, json_line(line))


@contextmanager
def new_series(
    path: Path, kind: str, name: str, of: Mapping[str, str], parts: int
) -> Iterator[RunSeries]:
    """Context in which a new series of `parts` runs is made, with a new manifest at
    `path`, which is locked meanwhile.

    Raises ConfigurationError where a file is at `path`, or none can be written.
    """
    head = {"schema": 1, "kind": kind, "name": name, "of": of, "parts": parts}
    with ExitStack() as opened:
        with writing(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            file = opened.enter_context(new_file(path))
            _lock(file.fileno(), path)
            write_all(file, json_line(head | _maker()))
            os.fsync(file.fileno())
        yield RunSeries(Manifest.read(path))


@contextmanager
def resumed_series(manifest: Manifest, of: Mapping[str, str]) -> Iterator[RunSeries]:
    """Context in which the series of `manifest` is continued, with its file locked
    meanwhile.

    Raises ConfigurationError where another process makes it, and where what it is `of`
    has changed since it began.
    """
    path = manifest.path
    with ExitStack() as opened:
        with writing(path):
            file = opened.enter_context(path.open("rb"))

        _lock(file.fileno(), path)
        current = Manifest.read(path)
        differ = [key for key in of if current.of.get(key) != of[key]]
        if differ:
            raise ConfigurationError(
                f"--resume: {path}: not as when this {current.kind} began:"
                f" {', '.join(differ)}; use what it began with, or begin another"
            )

        series = RunSeries(current)
        series.note(_maker())
        yield series


def _maker() -> dict[str, Any]:
    """Facts on this process, by name: its number, the name of its machine, and the
    present time.
    """
    began = datetime.now(UTC).isoformat(timespec="seconds")
    return {"process": os.getpid(), "host": os.uname().nodename, "began": began}


def _lock(handle: int, path: Path) -> None:
    """Lock the opened manifest with the descriptor `handle`; ConfigurationError where
    another process holds its lock.
    """
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise ConfigurationError(
            f"{Manifest.read(path)}; wait for it, or name another folder"
        ) from None
