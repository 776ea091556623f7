"""Checks of the machine: versions, cores, disk, kernel, real-time priorities,
libraries.
"""

import os
import platform
import resource
import shutil
import sys
from importlib.metadata import PackageNotFoundError, version
from math import inf
from pathlib import Path

from cell.setup.doctor.check import FAIL, PASS, SKIPPED, WARN, Check, Grade
from drivers.base.extras import install_line, missing_features

NEEDED_PACKAGES = ("mujoco", "numpy", "opencv-python-headless", "ruckig", "rerun-sdk")
# GB below which nothing is recorded, and from which all is well
RUN_GB, ROOM_GB = 1.0, 10.0
# for loop and images, and for the recording and viewer beside them
CORES, PLENTY = 2, 4
TOP_PRIORITY = 99  # of real-time scheduling, sched(7)
REALTIME = Path("/sys/kernel/realtime")
GOVERNORS = tuple(
    Path("/sys/devices/system/cpu").glob("cpu[0-9]*/cpufreq/scaling_governor")
)
THROTTLE = Path("/proc/sys/kernel/sched_rt_runtime_us")


def versions() -> Check:
    """Check whether all needed packages are installed, and state their versions."""
    found = [f"Python {platform.python_version()}"]
    missing = []
    for package in NEEDED_PACKAGES:
        try:
            found.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            missing.append(package)
    why = "a cell with other versions computes other numbers"
    if missing:
        remedy = f"{sys.executable} -m {install_line()}"
        return Check(
            name="versions",
            state=FAIL,
            found=f"missing: {', '.join(missing)}",
            why=why,
            remedy=remedy,
        )
    return Check(name="versions", state=PASS, found=", ".join(found), why=why)


def cores() -> Check:
    """Check whether this machine has enough processor cores for the control loop to
    have one alone.
    """
    count = len(os.sched_getaffinity(0))
    why = (
        "the control loop, images and the recording share the cores; a late tick stops"
        " the arm"
    )
    remedy = f"give this process at least {PLENTY} cores (taskset, container limits)"
    return Check(
        name="cores",
        state=_state(count, CORES, PLENTY),
        found=f"{count} usable",
        why=why,
        remedy=remedy,
    )


def _state(amount: float, needed: float, plenty: float) -> Grade:
    if amount < needed:
        return FAIL
    return WARN if amount < plenty else PASS


def _text(path: Path) -> str:
    """Text of the file of the kernel at `path`; empty where there is no such file."""
    return path.read_text(encoding="ascii").strip() if path.exists() else ""


def disk(runs: Path) -> Check:
    """Check whether runs can be recorded in the folder `runs`, by its permissions and
    its free space.
    """
    why = "a run that cannot be recorded stops in the middle of the fold"
    folder = next(p for p in (runs.absolute(), *runs.absolute().parents) if p.exists())
    if not folder.is_dir():
        remedy = "give a folder with --runs"
        return Check(
            name="disk", state=FAIL, found=f"{folder} is a file", why=why, remedy=remedy
        )
    if not os.access(folder, os.W_OK):
        return Check(
            name="disk",
            state=FAIL,
            found=f"{folder} cannot be written",
            why=why,
            remedy="mend its permissions",
        )
    free = shutil.disk_usage(folder).free / 1e9
    remedy = f"make room: `cell runs --runs {runs} --keep 100 --delete`"
    return Check(
        name="disk",
        state=_state(free, RUN_GB, ROOM_GB),
        found=f"{free:.1f} GB free for {runs}",
        why=why,
        remedy=remedy,
    )


def kernel(realtime: str) -> Check:
    """Check whether the kernel can keep the robot's millisecond, as the setting
    `realtime` of the cell file asks for it.
    """
    real = _text(REALTIME) == "1"
    found = f"{platform.release()}, {'real-time' if real else 'not real-time'}"
    why = (
        "the robot wants a command each millisecond; an ordinary kernel may be late by"
        " many"
    )
    remedy = "boot a PREEMPT_RT kernel, or set fci.realtime: priority in cell.yaml"
    if real:
        return Check(name="kernel", state=PASS, found=found, why=why)
    state = FAIL if realtime == "enforce" else WARN
    return Check(name="kernel", state=state, found=found, why=why, remedy=remedy)


def priority(realtime: str) -> Check:
    """Check whether this user's processes may have real-time priority and lock memory,
    as the setting `realtime` asks for it.
    """
    limits = (resource.RLIMIT_RTPRIO, resource.RLIMIT_MEMLOCK)
    allowed, locked = (
        inf if os.geteuid() == 0 or most == resource.RLIM_INFINITY else most
        for _, most in map(resource.getrlimit, limits)
    )
    ready = allowed >= TOP_PRIORITY
    memory = "any" if locked == inf else f"{locked / 1e6:.0f} MB"
    found = (
        f"real-time priority {'allowed' if ready else f'up to {allowed}'}, memory"
        f" {memory}"
    )
    why = (
        "without priority another program delays the process that owns the robot's loop"
    )
    remedy = (
        "add `@realtime - rtprio 99` and `@realtime - memlock 102400` to limits.conf,"
        " join it"
    )
    if ready:
        return Check(name="scheduler", state=PASS, found=found, why=why, remedy=remedy)
    state = WARN if realtime == "ignore" else FAIL
    return Check(name="scheduler", state=state, found=found, why=why, remedy=remedy)


def throttling() -> Check:
    """Check whether the kernel holds up real-time threads that use a core
    all the time.
    """
    share = int(_text(THROTTLE) or -1) / 1e4
    limited = 0.0 <= share < 100.0
    found = "real-time threads may fill it"
    if limited:
        found = f"{share:g} % of each second of a core"
    why = (
        "real-time threads that fill a core are all held up for the rest of the second;"
        " a robot stops after 20 ms without a command"
    )
    remedy = (
        "run nothing else in real time on these cores, or `sysctl"
        " kernel.sched_rt_runtime_us=-1`, from Linux 6.12 on also 0 in debugfs'"
        " sched/fair_server/cpu*/runtime"
    )
    few = len(os.sched_getaffinity(0)) < PLENTY
    return Check(
        name="throttling",
        state=WARN if limited and few else PASS,
        found=found,
        why=why,
        remedy=remedy,
    )


def governor() -> Check:
    """Check whether the kernel keeps the processor's cores at full speed."""
    why = "a core that sleeps or slows down answers the robot late"
    found = set(map(_text, GOVERNORS))
    if not found:
        return Check(
            name="governor", state=SKIPPED, found="this kernel has none", why=why
        )
    slow = found - {"performance"}
    remedy = "`cpupower frequency-set --governor performance`, at every start"
    state = WARN if slow else PASS
    return Check(
        name="governor",
        state=state,
        found=", ".join(sorted(found)),
        why=why,
        remedy=remedy,
    )


def extras() -> Check:
    """List the optional libraries that are missing; this check always passes, as each
    is needed for one feature only.
    """
    lost = missing_features()
    why = "only what stands in brackets needs it, and says so"
    found = ", ".join(f"{module} ({use})" for module, use in lost.items())
    text = f"not installed: {found}" if lost else "all optional libraries are installed"
    return Check(name="extras", state=PASS, found=text, why=why)
