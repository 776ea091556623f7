"""Diagnoses a case in a process that can read its runs and strip file and nothing else."""

import json
import os
import shutil
import site
import subprocess
import sys
import sysconfig
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import cell
from cell.config.places import cache_folder
from cell.record.files import PROFILE, RESULT, RUN, TICKS
from drivers.errors import CellError
from tests.lab.exam.sandbox.child import NOTES, VERDICT_FILE

FILES = (RUN, TICKS, PROFILE, RESULT)
PACKAGES = ("cell", "drivers", "policies", "calibration")
SYSTEM = ("/usr", "/lib", "/lib64", "/bin", "/etc", "/proc/self", "/proc/cpuinfo", "/proc/meminfo",
          "/proc/stat", "/sys/devices/system", "/sys/fs/cgroup")  # fmt: skip
ALLOWED_DEVICES = ("/dev/null", "/dev/urandom", "/dev/random", "/dev/zero")
SANDBOX_TIMEOUT = 1800.0  # s; it ends what hangs: how long a fit may take has a bar of its own
POLL_INTERVAL = 0.02  # s


class NoVerdict(CellError):
    """Error of a sandboxed process without verdict: it ran too long, died or refused its input."""


@dataclass(frozen=True, slots=True)
class SandboxRun:
    """Facts on a sandboxed process: `wall` time [s], peak `memory` [MB], use of the `kernel`."""

    wall: float
    memory: float
    kernel: bool


def run_sandboxed(
    strip: Path,
    runs: Sequence[Path],
    out: Path,
    sealed: Sequence[Path],
    *,
    limit: float = SANDBOX_TIMEOUT,
    workdirs: Path | None = None,
) -> SandboxRun:
    """Diagnose the `runs` of `strip` in a sandbox; writes verdict.json and exam.json to `out`.

    The runs are laid out in a new folder within `workdirs` (usually that of temporary files).
    `sealed` cannot be read, wherever it lies. Raises NoVerdict after `limit` [s], and with the
    last line that the process said where it failed.
    """
    with TemporaryDirectory(prefix="exam-", dir=workdirs) as name:
        workdir = Path(name).resolve()
        stage(workdir, strip, runs)
        wall, peak = _wait(_start(workdir, sealed), limit, workdir / "said")
        out.mkdir(parents=True, exist_ok=True)
        for file in (VERDICT_FILE, NOTES):
            shutil.copyfile(workdir / "out" / file, out / file)
    notes = json.loads((out / NOTES).read_text(encoding="utf-8"))
    return SandboxRun(wall, notes["memory"] or peak, notes["kernel"])


def stage(workdir: Path, strip: Path, runs: Sequence[Path]) -> None:
    """Copy the permitted files into `workdir`: the strip file and four files of each run."""
    shutil.copyfile(strip, workdir / "strip.yaml")
    for run in runs:
        folder = workdir / "runs" / run.name
        folder.mkdir(parents=True)
        for file in FILES:
            if (run / file).is_file():
                shutil.copyfile(run / file, folder / file)


def policy(workdir: Path, sealed: Sequence[Path]) -> dict[str, list[str]]:
    """Permissions of the sandboxed process, without the exam's code and the `sealed` paths."""
    root = Path(cell.__file__).resolve().parents[1]
    python = (sys.prefix, sys.base_prefix, sysconfig.get_path("purelib"), *site.getsitepackages(),
              *(path for path in sys.path if Path(path).name == "site-packages"))  # fmt: skip
    fonts = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "matplotlib"
    code = [str(root / name) for name in PACKAGES]
    return {
        "readable": [*dict.fromkeys(python), *code, *SYSTEM, str(fonts)],
        "writable": [str(workdir), str(cache_folder()), *ALLOWED_DEVICES],
        "sealed": [str(path.resolve()) for path in (*sealed, root / "cell" / "exam")],
    }


def _start(workdir: Path, sealed: Sequence[Path]) -> subprocess.Popen[bytes]:
    """Start the sandboxed process in `workdir`; its environment reveals nothing of the case."""
    permit = json.dumps(policy(workdir, sealed))
    command = [sys.executable, "-P", "-m", "tests.lab.exam.sandbox.child", permit]
    kept = ("PATH", "HOME", "XDG_CACHE_HOME", "NUMBA_CACHE_DIR", "LANG", "SYSTEMROOT")
    environment = {key: os.environ[key] for key in kept if key in os.environ}
    environment |= {
        "PYTHONPATH": str(Path(cell.__file__).resolve().parents[1]),
        "PYTHONDONTWRITEBYTECODE": "1",
        "TMPDIR": str(workdir),
        **dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"),
    }
    cache_folder().mkdir(parents=True, exist_ok=True)
    with (workdir / "said").open("wb") as said:
        return subprocess.Popen(
            command,
            cwd=workdir,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=said,
            stderr=said,
        )


def _wait(process: subprocess.Popen[bytes], limit: float, said: Path) -> tuple[float, float]:
    """Wait for the process, ended at `limit`; returns its wall time [s] and peak memory [MB].

    The kernel counts what the starting process held before, hence the process's own word first.
    """
    began = time.monotonic()
    try:
        while True:
            pid, status, usage = os.wait4(process.pid, os.WNOHANG)
            wall = time.monotonic() - began
            if pid:
                process.returncode = os.waitstatus_to_exitcode(status)
                break
            if wall > limit:
                raise NoVerdict(f"no verdict after {limit:.0f} s; the process was ended")
            time.sleep(POLL_INTERVAL)
    finally:
        if process.returncode is None:
            process.kill()
            process.wait()
    if process.returncode:
        lines = said.read_text(encoding="utf-8", errors="replace").strip().splitlines()
        last = lines[-1] if lines else "nothing was said"
        raise NoVerdict(f"the workflow ended with code {process.returncode}: {last}")
    return wall, usage.ru_maxrss / 1024
