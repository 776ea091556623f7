"""Series of folds that can be resumed: what they are of, and what is left of them."""

import hashlib
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from secrets import token_hex

from cell.base.campaign.journal import digest
from cell.folding.request import Request
from cell.folding.result import FoldResult
from cell.record.files import MANIFEST
from cell.record.manifest import (
    Manifest,
    RunSeries,
    manifests_in,
    new_series,
    resumed_series,
)
from drivers.base.errors import ConfigurationError


def identity(requests: Sequence[Request]) -> dict[str, str]:
    """Digests of the strip, the cell, the simulated strip and the planned folds, by
    name, by which a series that is resumed is known to be the same.

    The plan has policies, speeds, fold lines, seeds, whether at full speed, weights and
    the number of folds.
    """
    first = requests[0]
    plants = [
        request.trial.plant.model_dump_json()
        for request in requests
        if request.trial.plant
    ]
    plan = [
        f"{request.policy} {request.speed} {request.at} {request.trial.seed}"
        f" {request.full_speed}"
        for request in requests
    ]
    weights = b"" if first.checkpoint is None else first.checkpoint.read_bytes()
    return {
        "strip": digest(first.strip.model_dump_json()),
        "cell": digest(first.cell.model_dump_json(by_alias=True)),
        "plant": digest(*plants),
        "plan": digest(*plan, hashlib.sha256(weights).hexdigest()),
    }


@contextmanager
def series_of(
    requests: Sequence[Request],
    kind: str,
    path: Path | None = None,
    *,
    resuming: bool = False,
) -> Iterator["Remainder"]:
    """Context in which a series of folds is made, a new one or, where `resuming`, one
    that was begun before; it gives the folds that are left.

    Its manifest lies at `path`, or has a name of its own in the folder of the runs.
    Raises ConfigurationError where it cannot be written, or not be resumed.
    """
    opened = (_resume if resuming else _begin)(requests, kind, path)
    with opened as series:
        yield Remainder.of(series, requests)


def _begin(
    requests: Sequence[Request], kind: str, path: Path | None
) -> AbstractContextManager[RunSeries]:
    """Begin a new series of folds, whose progress is noted in a file;
    ConfigurationError where that cannot be written.
    """
    strip = requests[0].strip.name
    runs = requests[0].runs
    stamp = f"{datetime.now(UTC):%Y%m%dT%H%M%SZ}-{strip}-{kind}-{token_hex(2)}"
    manifest = runs / f"{stamp}.{MANIFEST}" if path is None else path
    return new_series(
        path=manifest, kind=kind, name=strip, of=identity(requests), parts=len(requests)
    )


def _resume(
    requests: Sequence[Request], kind: str, path: Path | None
) -> AbstractContextManager[RunSeries]:
    """Go on with the series whose progress is noted in the file at `path`, or with the
    newest unfinished one where that is None.

    Raises ConfigurationError where there is none, it is under way, or it was begun with
    another strip, cell, plant or plan.
    """
    runs = requests[0].runs
    if path is not None:
        found = [Manifest.read(path)] if path.is_file() else []
    else:
        found = [
            each
            for each in manifests_in(runs)
            if each.kind == kind and each.path.parent == runs and not each.is_complete
        ]
    if not found:
        raise ConfigurationError(
            f"--resume: no unfinished {kind} in {runs}; leave --resume out to begin one"
        )
    return resumed_series(found[-1], identity(requests))


@dataclass(frozen=True, slots=True)
class Remainder:
    """Folds of a series that are left to be made, in `requests`, with the `numbers` of
    these folds in the series by their random seed.
    """

    series: RunSeries
    requests: tuple[Request, ...]
    numbers: dict[int, int]

    @classmethod
    def of(cls, series: RunSeries, requests: Sequence[Request]) -> "Remainder":
        """What is left of a series: first the folds that never began, then, once more,
        those that began and did not end well.

        The latter get an index and a seed of their own, for the strip has been folded
        since: two runs with one index would be refused by a fit.
        """
        manifest = series.manifest
        left = [n for n in range(len(requests)) if n not in manifest.done]
        again = [n for n in left if n in manifest.begun]
        pairs = [(n, requests[n]) for n in left if n not in again]

        # earlier repeats have taken the first numbers after the last request's
        repeats = len(manifest.begun) - len(set(manifest.begun))
        last_index = max(request.trial.index for request in requests)
        last_seed = max(request.trial.seed for request in requests)
        for extra, number in enumerate(again, start=repeats + 1):
            trial = replace(
                requests[number].trial, index=last_index + extra, seed=last_seed + extra
            )
            pairs.append((number, replace(requests[number], trial=trial)))

        numbers = {request.trial.seed: number for number, request in pairs}
        return cls(series, tuple(request for _, request in pairs), numbers)

    def begin(self, request: Request) -> None:
        """Note in the file of the series that the fold of `request` begins."""
        self.series.begin(self.numbers[request.trial.seed])

    def end(self, request: Request, result: FoldResult) -> None:
        """Note in the file of the series that the fold of `request` has ended, and with
        which result.
        """
        facts = {"run": Path(result.run).name, "outcome": result.outcome}
        number = self.numbers[request.trial.seed]
        self.series.end(number, facts | {"exit_code": result.exit_code})

    def sentences(self) -> list[str]:
        """Sentences on how much of the series was done before, and on each fold that
        has to be made again.
        """
        manifest = self.series.manifest
        lines = [f"{len(manifest.done)} of {manifest.parts} are done"]
        for request in self.requests:
            number = self.numbers[request.trial.seed]
            if number in manifest.begun:
                ended = manifest.ended.get(number, {})
                outcome = ended.get("outcome", "its process ended")
                lines.append(f"number {number} is laid again: {outcome}")
        return lines
