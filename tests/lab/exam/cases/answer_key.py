"""Answer key of a case: the hidden cause, stored before the diagnosis and read by the scorer."""

import hashlib
from dataclasses import dataclass
from pathlib import Path

from cell.campaign import versions
from cell.record.documents import write_document
from drivers.settings import load
from policies.experiments.standard import REFERENCE_RUN, REPEATED_RUN, STANDARD
from tests.lab.exam.case import Case
from tests.lab.exam.runs.from_model import MOTIONS

KEYS_FOLDER = "keys"
EXAM = "tests/lab/exam"
SCORER = tuple(
    f"{EXAM}/{name}" for name in ("scoring/score.py", "scoring/oracle.py", "run_case.py")
)


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
    return Sources(engine=versions.verdicts(), scorer=versions.sources(SCORER))
