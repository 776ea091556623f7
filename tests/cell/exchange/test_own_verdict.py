"""Runs as CSV tables give the verdict of the run folders that they were made from."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import yaml

import cell
from cell.gap.verdict.schema import Verdict
from cell.record.exchange.mapping import MAPPING
from drivers.errors import CellError
from policies.experiments.standard import standard_order
from tests.support.gap_strip_cases import STRIP, folds, written

SAME = 0.02  # of an interval's width


@dataclass(frozen=True, slots=True)
class OwnRuns:
    """The same runs as folders, as CSV tables, and as tables of the tip alone."""

    runs: Path
    strip: Path
    work: Path

    def fits(self) -> tuple[Verdict, Verdict]:
        """The verdicts on the folders and on the tables."""
        places = self.runs, self.imported("csv", self.mapping({}))
        return tuple(
            cell.fit_gap([place], self.work / f"{place.name}-fit", strip=str(self.strip))
            for place in places
        )

    def of_tip_alone(self) -> Verdict:
        """The verdict on what the gripper's path alone says."""
        place = self.imported(
            "tip", self.mapping({"profile": None, "contact": None, "result": None})
        )
        return cell.fit_gap([place], self.work / "tip-fit", strip=str(self.strip))

    def mapping(self, changes: dict[str, object]) -> Path:
        """The mapping of the exported tables, with `changes`; then only the gripper is known."""
        tables = self.work / "tables"
        if not tables.exists():
            cell.export_runs(sorted(self.runs.iterdir()), "csv", tables)
        content = yaml.safe_load((tables / MAPPING).read_text()) | changes
        if changes:
            content["sigma"] = {"gripper": content["sigma"]["gripper"]}
        path = self.work / f"mapping-{len(changes)}.yaml"
        path.write_text(yaml.safe_dump({k: v for k, v in content.items() if v is not None}))
        return path

    def imported(self, name: str, mapping: Path) -> Path:
        """Run folders of the tables, read by `mapping`."""
        places = sorted(p for p in (self.work / "tables").iterdir() if p.is_dir())
        cell.import_runs(places, self.work / name, mapping)
        return self.work / name


def differences(a: Verdict, b: Verdict) -> list[str]:
    """Where two verdicts say something else: kind, names, values beyond a part of an interval."""
    found = [] if a.verdict == b.verdict else [f"verdict {a.verdict}, {b.verdict}"]
    names = [[e.name for e in v.effects] for v in (a, b)]
    if names[0] != names[1]:
        return [*found, f"effects {names[0]}, {names[1]}"]
    if sorted(map(sorted, a.ambiguous)) != sorted(map(sorted, b.ambiguous)):
        found.append(f"ambiguous {a.ambiguous}, {b.ambiguous}")
    for one, other in zip(a.effects, b.effects, strict=True):
        for name, p in one.parameters.items():
            width = (p.high or p.value) - (p.low or p.value)
            if abs(p.value - other.parameters[name].value) > SAME * max(width, 1e-12):
                found.append(f"{one.name}.{name} {p.value}, {other.parameters[name].value}")
    return found


@pytest.mark.long
def test_eleven_runs_as_csv_give_the_verdict_of_their_folders(tmp_path: Path) -> None:
    made = folds(
        standard_order(np.random.default_rng(0)), {"bending_hysteresis": {"yield_curvature": 30.0}}
    )
    runs = written(tmp_path / "runs", made)[0].parent
    own = OwnRuns(runs, STRIP, tmp_path)
    folders, tables = own.fits()
    assert folders.verdict == "named"
    assert not differences(folders, tables)
    with pytest.raises(CellError):
        own.of_tip_alone()
