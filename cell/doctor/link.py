"""Measurement of the network to a robot, whose states should arrive each millisecond.

Runs as a process of its own, `python -m cell.doctor.link ADDRESS SECONDS`: reading blocks, and the
client library changes the scheduler of the process that connects.
"""

import json
import subprocess
import sys
import time
from dataclasses import asdict, dataclass

import numpy as np

from drivers.errors import CellError

STARTING = 30.0  # s that the process may need beyond its measurement
BUFFERED = 0.25  # s at the start of a measurement


@dataclass(frozen=True, slots=True)
class Link:
    """Statistics of a robot's states over `seconds`: number, losses, times between arrivals [ms].

    `in_a_row` is the most states lost in a row; `late_ms` the 99.9th percentile of the times
    between two arrivals, `worst_ms` the longest.
    """

    seconds: float
    states: int
    lost: int
    in_a_row: int
    late_ms: float
    worst_ms: float

    @property
    def lost_share(self) -> float:
        """Share of the states that did not arrive."""
        return self.lost / max(self.states + self.lost, 1)


def measured_link(address: str, seconds: float) -> Link:
    """Measure the link to the robot at `address`, over `seconds`; CellError if unreachable."""
    command = [sys.executable, "-m", "cell.doctor.link", address, f"{seconds:g}"]
    try:
        done = subprocess.run(  # noqa: S603  this interpreter, a module of ours
            command, capture_output=True, text=True, timeout=seconds + STARTING, check=False
        )
        return Link(**json.loads(done.stdout))
    except subprocess.TimeoutExpired:
        raise CellError(f"{address}: no answer within {seconds + STARTING:.0f} s") from None
    except (ValueError, TypeError):
        lines = done.stderr.strip().splitlines() or ["no reason given"]
        raise CellError(f"{address}: {lines[-1]:.200}") from None


def link_of(
    times: "np.typing.NDArray[np.int64]", arrivals: "np.typing.NDArray[np.float64]"
) -> Link:
    """Statistics of a link from `times` (n,) [ms] of the robot's states and `arrivals` (n,) [s].

    The time BUFFERED at the start does not count: what waits in a buffer arrives at once.
    """
    kept = arrivals > arrivals[0] + BUFFERED
    times, arrivals = times[kept], arrivals[kept]
    missing = np.maximum(np.diff(times) - 1, 0)
    apart = 1e3 * np.diff(arrivals)
    return Link(
        seconds=float(arrivals[-1] - arrivals[0]),
        states=len(times),
        lost=int(missing.sum()),
        in_a_row=int(missing.max(initial=0)),
        late_ms=float(np.percentile(apart, 99.9)),
        worst_ms=float(apart.max(initial=0.0)),
    )


def main() -> None:
    """Read states for the seconds on the command line and print the link's statistics as JSON."""
    import pylibfranka as franka

    address, seconds = sys.argv[1], float(sys.argv[2])
    robot = franka.Robot(address, franka.RealtimeConfig.kIgnore)
    times, arrivals = list[int](), list[float]()
    until = time.monotonic() + seconds + BUFFERED
    while not arrivals or arrivals[-1] < until:
        state = robot.read_once()
        arrivals.append(time.monotonic())
        times.append(round(1e3 * state.time.to_sec()))
    sys.stdout.write(json.dumps(asdict(link_of(np.array(times), np.array(arrivals)))))


if __name__ == "__main__":
    main()
