"""Folders of finished fits, as `cell gap fit` leaves them to what comes after it."""

import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from cell.base.config.places import find_configs
from cell.gap.subject.mechanism.subject import MechanismSubject
from cell.gap.subject.strip.subject import patch_file
from cell.gap.subject.subject import NamedValues
from cell.gap.verdict.accept import AcceptResult, accept, undo
from cell.gap.verdict.fit_folder import (
    VERDICT,
    FitRecord,
    finish,
    patch_files,
    results_folder,
)
from cell.gap.verdict.schema import Step, StepKind, Verdict
from drivers.base.files import write_file
from drivers.base.readers import file_digest
from drivers.base.yaml_text import dump_yaml
from drivers.strip.describe import load_strip

EFFECT = {"bending_hysteresis": {"yield_curvature": 20.0, "stiffness_ratio": 8.0}}
LOOK = Step("look", "", "report.html shows where it sits")


def verdict_of(**changes: object) -> Verdict:
    """A verdict without a gap, and `changes`."""
    sizes = {"before": {"excess": 0.0}, "after": {}, "floor": {}}
    gap = sizes | {"shrink": 0.0, "shrink_low": 0.0, "shrink_high": 0.0}
    lists = {
        key: [] for key in ("effects", "ambiguous", "where", "candidates", "advice")
    }
    facts = lists | {"verdict": "no_gap", "unexplained": None, "base": {}, "gap": gap}
    facts |= {"detectable": {}, "held_out": [], "runtime": 1.0, "simulations": 1}
    return Verdict.model_validate(facts | changes)


def write_fit(
    out: Path,
    file: Path,
    kind: StepKind,
    contents: Mapping[str, str | bytes],
    verdict: Verdict | None = None,
    **facts: Any,
) -> None:
    """Leave in `out` a finished fit of `file`, of which the step `kind` accepts
    something.

    `contents` are its patches of `subject`, `model` and `cell`; `facts` go into its
    record.
    """
    files = patch_files(kind, contents)
    own = {
        "file": str(file),
        "file_sha256": file_digest(file),
        "effects": tuple(EFFECT),
    }
    record = FitRecord(**{**own, "patches": {kind: files}, **facts})
    with results_folder(out) as stage:
        for role, content in contents.items():
            write_file(stage / getattr(files, role), content)
        write_file(stage / VERDICT, (verdict or verdict_of(next=LOOK)).to_json())
        finish(stage, record)


def write_mechanism_fit(
    out: Path,
    file: Path,
    subject: MechanismSubject,
    base: Mapping[str, float],
    effects: NamedValues,
) -> None:
    """Leave in `out` a finished fit of the mechanism in `file` that named `effects`."""
    patch, of_cell = subject.patch(base, effects, "test")
    contents = {"subject": dump_yaml(patch), **subject.model_texts(base, effects)}
    if of_cell:
        contents["cell"] = dump_yaml(of_cell)
    digests = subject.mechanism.source.digests.items()
    parts = {os.path.relpath(path, file.parent): digest for path, digest in digests}
    write_fit(out, file, "accept", contents, effects=tuple(effects), parts=parts)


CELL = {"effects": {"desk_tilt": {"angle": 0.004}}}
"""Patch of a cell file."""


class Fitted:
    """Folder of a finished fit, with its strip file and cell file.

    What it offers is a patch of yarn friction, and of the `cell` if given.
    """

    def __init__(
        self, root: Path, kind: StepKind = "accept", cell: Mapping | None = None
    ) -> None:
        root.mkdir(exist_ok=True)
        self.out, self.file = root / "out", root / "denim.yaml"
        self.cell = root / "cell.yaml"
        shutil.copy(find_configs(None).strip_path("denim"), self.file)
        shutil.copy(find_configs(None).folder / "cell.yaml", self.cell)
        patch, _ = patch_file(
            load_strip(self.file), {"bending_length": 0.0168}, EFFECT, "fit"
        )
        contents = {"subject": yaml.safe_dump(patch)}
        if cell is not None:
            contents["cell"] = yaml.safe_dump(cell)
        self.kind, self.contents = kind, contents
        self.write()

    @property
    def stored(self) -> tuple[bytes, bytes]:
        """Contents of the strip file and the cell file."""
        return self.file.read_bytes(), self.cell.read_bytes()

    @property
    def record(self) -> Path:
        """Where what undoes an acceptance is kept."""
        return self.file.with_name("denim.yaml.undo.json")

    def accept(self, **how: bool) -> AcceptResult:
        """Accept the fit into its strip file and cell file."""
        return accept(self.out, self.file, self.cell, **how)

    def undo(self) -> AcceptResult:
        """Take the last acceptance back."""
        return undo(self.out, self.file, self.cell)

    def write(self, **changed: str | bytes) -> None:
        """Write the fit again, of the files as they are now, with `changed` patches."""
        contents = self.contents | changed
        write_fit(
            self.out,
            self.file,
            self.kind,
            contents,
            cell_sha256=file_digest(self.cell),
        )
