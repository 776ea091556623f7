"""Measures one part in the present process, and writes its record to the journal."""

import json
import os
import resource
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel
from pydantic_core import to_json

from cell.campaign.journal import Cost, Journal, Record
from cell.campaign.part import Part
from cell.campaign.worker import StopSignal
from drivers.errors import CellError, Unexpected


def measure(
    part: Part, folder: Path, versions: Mapping[str, str], _stop: StopSignal | None = None
) -> Record:
    """Measure `part` and store its record in the journal at `folder`; reuses a finished record.

    A part that raises is `failed`, with the reason. Raises ConfigurationError where the journal
    cannot be written.
    """
    journal = Journal(folder)
    known = journal.get(part.key, part.of)
    if known is not None and known.done:
        return known
    begun, processor_before, outcome, reason = time.perf_counter(), _processor_time(), None, ""
    try:
        outcome = plain(part.measure())
    except CellError as error:
        reason = str(error)
    except Exception as error:  # noqa: BLE001  an edge: the other parts go on
        reason = str(Unexpected(error))
    record = Record(
        schema=1,
        key=part.key,
        of=part.of,
        state="failed" if outcome is None else "measured",
        outcome=outcome,
        reason=reason,
        cost=Cost(wall=time.perf_counter() - begun, processor=_processor_time() - processor_before),
        versions=dict(versions),
        host=os.uname().nodename,
    )
    journal.put(record)
    return record


def plain(outcome: Mapping[str, Any] | BaseModel) -> dict[str, Any]:
    """Convert `outcome` to plain JSON values; a number that is not finite becomes None."""
    content = to_json(dict(outcome), inf_nan_mode="null", fallback=lambda value: value.tolist())
    found: dict[str, Any] = json.loads(content)
    return found


def set_aside(part: Part, reason: str, folder: Path, versions: Mapping[str, str]) -> Record:
    """Store and return a record for `part` that gave none itself, with the `reason`."""
    facts: dict[str, Any] = {"state": "set_aside", "reason": reason, "versions": dict(versions)}
    record = Record(schema=1, key=part.key, of=part.of, host=os.uname().nodename, **facts)
    Journal(folder).put(record)
    return record


def prepare(_stop: StopSignal | None = None) -> None:
    """Compile the rod before work begins."""
    from drivers.strip.describe import describe
    from drivers.strip.file import paper_strip
    from drivers.strip.rod.engine import Rod

    rod = Rod(20)
    rod.reset([describe(paper_strip(0.1, 0.01))])
    rod.step(np.array([[0.6, 0.0, 0.0]]), 0.005)


def _processor_time() -> float:
    """Processor time [s] of this process and of its children that have ended."""
    both = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(used.ru_utime + used.ru_stime for used in both)
