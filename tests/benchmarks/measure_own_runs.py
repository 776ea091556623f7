"""Runs as CSV tables, and of them the tip alone: the verdict on them beside that on the folders.

python -m tests.benchmarks.measure_own_runs RUNS [--strip configs/strips/denim.yaml] [--work DIR]

RUNS is a folder of runs, as `cell gap plan` makes it. The work folder holds the exported tables,
the imported runs and the fits. Of the tip alone, the gripper's path, the program must say what
would show the strip; with the touch of the layers it must give a verdict.
"""

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path
from tempfile import mkdtemp

import yaml

import cell
from cell.gap.verdict.schema import Verdict
from cell.record.exchange.mapping import MAPPING
from drivers.errors import CellError

SAME = 0.02  # of an interval's width


@dataclass(frozen=True, slots=True)
class OwnRuns:
    """The same runs as folders, as CSV tables, and as tables of the tip and the touch alone."""

    runs: Path
    strip: Path
    work: Path

    def fits(self, tip: bool = True) -> dict[str, Verdict]:
        """The verdicts by what was fitted; `tip` and touch alone too, where wanted."""
        places = {"folders": self.runs, "csv": self.imported("csv", self.mapping({}))}
        if tip:
            bare = {"profile": None, "contact": None}
            places["tip and touch"] = self.imported("touch", self.mapping(bare))
        return {
            name: cell.fit_gap([place], self.work / f"{name}-fit", strip=str(self.strip))
            for name, place in places.items()
        }

    def refusal(self) -> str:
        """What is said to the tip alone."""
        bare = {"profile": None, "contact": None, "result": None}
        place = self.imported("tip", self.mapping(bare))
        try:
            cell.fit_gap([place], self.work / "tip-fit", strip=str(self.strip))
        except CellError as error:
            return str(error)
        raise SystemExit("tip: a verdict from nothing")

    def mapping(self, changes: dict[str, object]) -> Path:
        """The mapping of the exported tables, with `changes`; then only the tip is known."""
        tables = self.work / "tables"
        if not tables.exists():
            cell.export_runs(sorted(self.runs.iterdir()), "csv", tables)
        content = yaml.safe_load((tables / MAPPING).read_text()) | changes
        if changes:
            kept = {"gripper"} | (
                {"displacement", "touch_time"} if "result" not in changes else set()
            )
            content["sigma"] = {k: v for k, v in content["sigma"].items() if k in kept}
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


def lines(name: str, verdict: Verdict) -> list[str]:
    """What a verdict says, with what to do next."""
    said = [f"{name}: {verdict.verdict}"]
    for effect in verdict.effects:
        for key, p in effect.parameters.items():
            said.append(f"  {effect.name}.{key} {p.value:.4g} ({p.low:.4g} to {p.high:.4g})")
    said += [f"  cannot tell apart: {', '.join(names)}" for names in verdict.ambiguous]
    if verdict.unexplained is not None:
        said.append(f"  {verdict.unexplained.description}")
    said += [
        f"  advice: {a.experiment} separates {' from '.join(a.separates)} by {a.expected_sigma:.1f}"
        for a in verdict.advice
    ]
    return [*said, f"  {verdict.simulations} simulations, {verdict.runtime:.0f} s"]


def main() -> int:
    """Fit all three and print them; 1 where the tables give another verdict than the folders."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("runs", type=Path)
    parser.add_argument("--strip", type=Path, default=Path("configs/strips/denim.yaml"))
    parser.add_argument("--work", type=Path)
    asked = parser.parse_args()
    own = OwnRuns(asked.runs, asked.strip, asked.work or Path(mkdtemp(prefix="own-runs-")))
    sys.stdout.write(f"tip: {own.refusal()}\n")
    verdicts = own.fits()
    for name, verdict in verdicts.items():
        sys.stdout.write("\n".join(lines(name, verdict)) + "\n")
    other = differences(verdicts["folders"], verdicts["csv"])
    sys.stdout.write("\n".join(other or ["csv: the same verdict as the folders"]) + "\n")
    return 1 if other else 0


if __name__ == "__main__":
    sys.exit(main())
