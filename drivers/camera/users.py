"""Processes that have a device open, for the message to the operator."""

import os
from pathlib import Path

NOBODY_KNOWN = "another program of a user whose processes are hidden"


def users_of(device: str, processes: Path = Path("/proc")) -> str:
    """Names and numbers of the other processes that hold `device`, as far as they may be seen."""
    node = os.path.realpath(device)
    found = [
        f"{_name(process)} (process {process.name})"
        for process in sorted(processes.glob("[0-9]*"))
        if process.name != str(os.getpid()) and _holds(process, node)
    ]
    return ", ".join(found) or NOBODY_KNOWN


def _holds(process: Path, node: str) -> bool:
    try:
        return any(str(entry.readlink()) == node for entry in (process / "fd").iterdir())
    except OSError:
        return False  # ended meanwhile, or not ours to look at


def _name(process: Path) -> str:
    try:
        return (process / "comm").read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return "a program"
