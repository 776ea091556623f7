"""Unknown strips folded by `adaptive` through images: how far off, and how well it was foretold.

python -m tests.benchmarks.measure_unknown [--hidden nothing,friction,seam] [--count N] [--first K]
    [--calipers] [--rate 30] [--dropped 0.5] [--noise 0.003] [--checkpoint FILE] [--kept FILE]

Strips are drawn over the paper's range, each with the effect named by --hidden at textile size:
`friction`, `nothing`, one of the library's, or two joined by a plus. A cell that knows only their
length folds them, with --calipers also their thickness. Strip K of a name is the same in every run.
Of its images a share --dropped is lost; --noise [m] is added to what is read from them. Prints for
every name |d| and final offset of the edges by truth, what the camera said of the edges, the share
of folds within one and 1.96 sigma of what was foretold, and the errors of the belief. --kept adds
what is known of each fold to a file, one JSON object a line.
"""

import argparse
import json
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from zlib import crc32

import numpy as np
import yaml

from cell.config.places import find_configs
from cell.config.unknown import name_of
from cell.devices.devices import DeviceSelection
from cell.operations.fold import Request, fold
from cell.operations.result import FoldResult
from cell.record.header import ForetoldNote
from cell.record.run import read_run
from drivers.strip.file import StripFile
from policies.adaptive.fabrics import LENGTH, effect, friction, plain
from policies.adaptive.train.piece import truth
from tests.support.poor_images import dropping, noisy

FRICTION = (20.0, 60.0)  # 1/m


@dataclass(frozen=True)
class Row:
    """One fold: its result, what was foretold at the touch, and the strip."""

    result: FoldResult
    foretold: ForetoldNote | None
    strip: StripFile

    def numbers(self) -> tuple[float, ...]:
        """d, edges, edges seen, d foretold, sigma [mm]; errors of the belief; NaN where none."""
        made, told = self.result, self.foretold
        lengths = (made.displacement_true, made.edge_offset_true, made.edge_offset)
        lengths += (None, None) if told is None else (told.displacement, told.sigma)
        millimetres = [np.nan if value is None else 1e3 * value for value in lengths]
        if told is None:
            return (*millimetres, np.nan, np.nan)
        c, tau, _ = truth(self.strip)
        off = np.log(told.bending_length.value) - c, np.log(told.retardation_time.value) - tau
        return (*millimetres, float(off[0]), float(off[1]))

    def facts(self) -> dict[str, object]:
        """What is known of the fold, in SI."""
        told = None if self.foretold is None else self.foretold.model_dump(mode="json")
        result = self.result
        return {
            "outcome": result.outcome,
            "displacement": result.displacement_true,
            "edges": result.edge_offset_true,
            "edges_seen": result.edge_offset,
            "foretold": told,
            "strip": self.strip.model_dump(mode="json", by_alias=True),
        }


def drawn(hidden: str, number: int) -> StripFile:
    """Strip `number` with the effects named by `hidden`."""
    rng = np.random.default_rng([crc32(hidden.encode()), number])
    effects = {}
    for name in hidden.split("+"):
        if name == "friction":
            effects["bending_hysteresis"] = friction(rng, *FRICTION)
        elif name != "nothing":
            effects[name] = effect(name, rng)
    return plain(rng, **effects)


@dataclass(frozen=True)
class Bench:
    """Where and how strips are folded: `configs`, a `folder` for the runs, weights, what is known,
    and what is wrong with the images.
    """

    configs: Path
    folder: Path
    checkpoint: Path | None
    calipers: bool
    dropped: float
    noise: float

    def folded(self, strip: StripFile, number: int) -> Row:
        """The fold of `strip`, which the cell does not know."""
        name = name_of(LENGTH, strip.thickness if self.calipers else None)
        plant = self.folder / "plant.yaml"
        content = strip.model_dump(mode="json", by_alias=True)
        plant.write_text(yaml.safe_dump(content), encoding="utf-8")
        request = Request(
            *(name, "adaptive", self.checkpoint, DeviceSelection(plant=plant, seed=number)),
            *(self.folder / "runs", self.configs, "none", True, "off"),
        )
        with self._noisy(number):
            result = fold(request, page=False, opened=dropping(self.dropped, number))
        stored = read_run(Path(result.run)).result
        return Row(result, None if stored is None else stored.foretold, strip)

    def _noisy(self, seed: int) -> AbstractContextManager[object]:
        return noisy(self.noise, seed) if self.noise > 0 else nullcontext()


def at_rate(rate: float | None, folder: Path) -> Path:
    """A folder of configurations whose camera takes `rate` images a second."""
    configs = find_configs(None)
    if rate is None:
        return configs.folder
    content = configs.cell().model_dump(mode="json", by_alias=True)
    content["twin"]["camera"]["rate"] = rate
    made = folder / "configs"
    made.mkdir()
    (made / "cell.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    return made


def line(name: str, rows: list[Row]) -> str:
    """Summary of the folds of one name."""
    found = np.array([row.numbers() for row in rows])
    d, edges, seen, foretold, sigma, c, tau = found.T
    ratio = np.abs(d - foretold) / sigma
    rms = 100 * np.sqrt(np.nanmean(np.square([c, tau]), axis=1))
    return (
        f"{name:22s} {len(rows)} folds, |d| {told(d)}, edges {told(edges)}, seen off by "
        f"{told(seen - edges)} mm; d minus foretold {np.nanmean(d - foretold):+.2f}, sigma "
        f"{np.nanstd(d - foretold):.2f} mm, within {100 * np.mean(ratio < 1):.0f} and "
        f"{100 * np.mean(ratio < 1.96):.0f} %; belief off by {rms[0]:.1f} % in length, "
        f"{rms[1]:.0f} % in time; {np.isnan(d).sum()} without a touch"
    )


def told(values: np.typing.NDArray[np.float64]) -> str:
    size = np.abs(values)
    return f"{np.nanmean(size):.2f} / {np.nanquantile(size, 0.95):.2f} / {np.nanmax(size):.2f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hidden", default="nothing,friction")
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--rate", type=float)
    parser.add_argument("--dropped", type=float, default=0.0)
    parser.add_argument("--noise", type=float, default=0.0)
    parser.add_argument("--calipers", action="store_true")
    parser.add_argument("--checkpoint", type=Path)
    parser.add_argument("--kept", type=Path)
    asked = parser.parse_args()
    with TemporaryDirectory() as place:
        folder = Path(place)
        configs = at_rate(asked.rate, folder)
        known = asked.checkpoint, asked.calipers
        bench = Bench(configs, folder, *known, asked.dropped, asked.noise)
        for name in asked.hidden.split(","):
            rows = []
            for number in range(asked.first, asked.first + asked.count):
                rows.append(bench.folded(drawn(name, number), number))
                numbers = " ".join(f"{value:+6.2f}" for value in rows[-1].numbers())
                print(f"{name} {number} {rows[-1].result.outcome} {numbers}", flush=True)
                keep(asked.kept, {"hidden": name, "number": number, **rows[-1].facts()})
            print(line(name, rows), flush=True)


def keep(path: Path | None, facts: dict[str, object]) -> None:
    """Add `facts` to the file at `path`, if there is one."""
    if path is not None:
        with path.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(facts) + "\n")


if __name__ == "__main__":
    main()
