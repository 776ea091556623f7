"""What a fit of the cell's arm explains: `python -m tests.lab draw-arm FIT RUNS PNG` draws
the torques of four joints, measured less predicted, before and after the named effects.
"""

from pathlib import Path

import matplotlib as mpl
import numpy as np

from cell.config.places import find_configs
from cell.gap.subject.mechanism.subject import open_mechanism
from cell.gap.subject.run_folders import find_runs
from cell.gap.subject.subject import Request
from cell.gap.verdict.schema import read_verdict

mpl.use("Agg")
from matplotlib.figure import Figure

JOINTS = (1, 2, 4, 6)


def main(fitted: Path, runs: Path, place: Path) -> None:
    """Predict the first run with and without what was named, and draw what is left of it."""
    verdict = read_verdict(fitted / "verdict.json")
    subject = open_mechanism(find_configs(None).mechanism_path("arm"), find_runs([runs]))
    run, scope = subject.runs[0], subject.scope
    base = np.array([verdict.base[p.name].value for p in scope.base])
    known = {c.name: c for c in scope.candidates}
    named = {e.name: np.array([e.parameters[p.name].value for p in known[e.name].parameters])
             for e in verdict.effects}  # fmt: skip
    own = np.array([p.start for p in run.local])
    before, after = subject.draw_simulated(
        [Request(run, base, {}, own), Request(run, base, named, own)]
    )
    figure = Figure(figsize=(7.0, 5.2), layout="constrained")
    rest = ", measured - simulated"
    for axes, joint in zip(figure.subplots(len(JOINTS), 1, sharex=True), JOINTS, strict=True):
        wanted = f"torque{joint}{rest}"
        for scene, colour, label in ((before, "#c0392b", "the model as it stands"),
                                     (after, "#2471a3", "with " + ", ".join(named))):  # fmt: skip
            signal = next(s for s in scene.signals if s.title == wanted)
            axes.plot(signal.t, signal.values, color=colour, lw=0.8, label=label)
        axes.set_ylabel(f"joint {joint} [N m]")
        axes.grid(alpha=0.3)
    figure.axes[0].legend(loc="upper right", fontsize=8, ncols=2)
    figure.axes[0].set_title(
        "torque, measured less predicted, along one path of a fold", fontsize=10
    )
    figure.axes[-1].set_xlabel("time [s]")
    figure.savefig(place, dpi=110)
