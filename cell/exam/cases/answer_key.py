"""Answer key of a case: the hidden cause, stored before the diagnosis and read by the scorer."""

import hashlib
from dataclasses import dataclass
from pathlib import Path

import cell
import drivers
from cell.exam.case import Case
from cell.exam.runs.from_model import MOTIONS
from cell.record.documents import write_document
from drivers.settings import load
from policies.experiments.standard import REFERENCE_RUN, REPEATED_RUN, STANDARD

KEYS_FOLDER = "keys"
ENGINE = ("gap", "record")
"""Folders of the package `cell` on which verdicts depend, beside the strip's model."""

SCORER = ("scoring/score.py", "scoring/oracle.py", "run_case.py")


def seal(case: Case, folder: Path) -> Path:
    """Write the answer key of `case` to `folder`, readable by its owner alone; returns its path."""
    keys = folder / KEYS_FOLDER
    keys.mkdir(mode=0o700, parents=True, exist_ok=True)
    path = keys / f"{case.name}.yaml"
    write_document(path, case.model_dump(mode="json"))
    path.chmod(0o600)
    return path


def open_key(folder: Path, name: str) -> Case:
    """Read the case `name` from its answer key; raises ConfigurationError if that is broken."""
    return load(folder / KEYS_FOLDER / f"{name}.yaml", Case)


def case_hash(case: Case) -> str:
    """Digest of all fields of a case and of the names of its motions."""
    made = MOTIONS if case.tier == "state" else (*STANDARD, REPEATED_RUN, REFERENCE_RUN)
    return hashlib.sha256((case.model_dump_json() + " ".join(made)).encode()).hexdigest()[:16]


@dataclass(frozen=True, slots=True)
class Sources:
    """Digests of the source code that makes verdicts (`engine`) and that scores them (`scorer`)."""

    engine: str
    scorer: str

    def verdict(self, case: Case) -> str:
        """Digest of everything that the verdict on `case` depends on."""
        return f"{self.engine}-{case_hash(case)}"

    def entry(self, case: Case) -> str:
        """Digest of everything that the ledger entry of `case` depends on."""
        return f"{self.verdict(case)}-{self.scorer}"


def sources() -> Sources:
    """Digests of the source files as they are on disk now."""
    package, model = Path(cell.__file__).parent, Path(drivers.__file__).parent / "strip"
    here = Path(__file__).parents[1]
    return Sources(
        engine=_digest([*(package / name for name in ENGINE), model]),
        scorer=_digest([here / name for name in SCORER]),
    )


def _digest(places: list[Path]) -> str:
    h = hashlib.sha256()
    for place in places:
        found = (path for kind in ("*.py", "*.yaml") for path in place.rglob(kind))
        files = [place] if place.is_file() else sorted(found)
        for path in files:
            h.update(str(path.relative_to(place.parent)).encode() + path.read_bytes())
    return h.hexdigest()[:16]
