"""Check of the network to a robot, whose states should arrive each millisecond."""

import time
from dataclasses import dataclass
from multiprocessing.connection import Connection

import numpy as np

from cell.doctor.check import Check, State
from drivers.child import Child, ChildDied
from drivers.errors import CellError

STARTING = 30.0  # s that the process may need beyond its measurement
BUFFERED = 0.25  # s at the start of a measurement
LOST_SHARE, TOO_MANY, IN_A_ROW = 0.01, 0.10, 20  # shares of states; the robot itself stops after 20
LARGEST_DELAY_MS = 2.0  # ms between two states, 99.9 % of them
WHY = "a robot that misses 20 commands in a row stops with a reflex"


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


def network(address: str, seconds: float) -> Check:
    """Check whether the robot's states arrive as they are sent, over `seconds`."""
    try:
        return judge_link(measure_link(address, seconds))
    except CellError as error:
        remedy = "close other programs that hold the robot; check cable and address"
        return Check("network", State.FAIL, str(error), WHY, remedy)


def judge_link(link: Link) -> Check:
    """Check whether a measured network `link` loses few states, and none for long."""
    remedy = (
        "connect the robot to a network card of its own, without a switch; switch off power saving "
        "of processor and card; close busy programs"
    )
    found = (
        f"{link.states} states in {link.seconds:.0f} s, {100 * link.lost_share:.2f} % lost, at "
        f"most {link.in_a_row} in a row; 99.9 % within {link.late_ms:.1f} ms, worst "
        f"{link.worst_ms:.1f} ms"
    )
    state = State.PASS
    if link.lost_share > LOST_SHARE or link.late_ms > LARGEST_DELAY_MS:
        state = State.WARN
    if link.lost_share > TOO_MANY or link.in_a_row >= IN_A_ROW:
        state = State.FAIL
    return Check("network", state, found, WHY, remedy)


def measure_link(address: str, seconds: float) -> Link:
    """Measure the link to the robot at `address`, over `seconds`; CellError if unreachable.

    In a process of its own: reading blocks, and the client library changes the scheduler of the
    process that connects.
    """
    child = Child(read_states, address, seconds)
    try:
        link: Link | None = child.receive(seconds + STARTING)
    except ChildDied as died:
        text = str(died) if died.failure is None else died.failure.text
        raise CellError(f"{address}: {' '.join(text.split())[:200]}") from None
    finally:
        child.kill()
    if link is None:
        raise CellError(f"{address}: no answer within {seconds + STARTING:.0f} s")
    return link


def read_states(pipe: Connection, address: str, seconds: float) -> None:
    """Run in the process: read the robot's states for `seconds`, and send the link's statistics."""
    import pylibfranka as franka

    robot = franka.Robot(address, franka.RealtimeConfig.kIgnore)
    times, arrivals = list[int](), list[float]()
    until = time.monotonic() + seconds + BUFFERED
    while not arrivals or arrivals[-1] < until:
        state = robot.read_once()
        arrivals.append(time.monotonic())
        times.append(round(1e3 * state.time.to_sec()))
    pipe.send(link_of(np.array(times), np.array(arrivals)))


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
