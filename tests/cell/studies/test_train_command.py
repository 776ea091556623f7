"""`cell train`: the same weights however often it is killed, an honest judgement, clear
errors.
"""

import fcntl
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from cell.base.campaign.processes import workers
from drivers.base.errors import WorkersLost
from policies.registry import make_policy
from tests.support.commands import refused, run

TINY = "--generations 6 --population 4 --strips 1 --grid 2"


def killed_after(folder: Path, generation: int) -> None:
    """A training in a process of its own, killed as soon as it tells of
    `generation`.
    """
    command = f"-m cell train --out {folder} --jobs 1 {TINY}"
    words = [sys.executable, *command.split()]
    with subprocess.Popen(words, stderr=subprocess.PIPE, text=True) as training:
        for line in training.stderr:
            if line.startswith(f"generation {generation} of 6"):
                training.kill()
                break
        training.stderr.read()
    assert training.returncode == -signal.SIGKILL


@pytest.mark.slow
def test_run_killed_twice_ends_with_the_weights_of_one_left_alone(
    monkeypatch, capsys, tmp_path: Path
) -> None:
    alone, killed = tmp_path / "alone", tmp_path / "killed"
    assert run(monkeypatch, "train --out", alone, "--jobs 1 --json", TINY) == 0
    line = json.loads(capsys.readouterr().out)
    killed_after(killed, 2)
    killed_after(killed, 4)
    assert run(monkeypatch, "train --out", killed, "--jobs 2", TINY) == 0
    told = capsys.readouterr()
    assert "resumed after 4 of 6" in told.err or "resumed after 5 of 6" in told.err
    assert "chain (the plant)" in told.out
    assert (alone / "feedback.json").read_bytes() == (
        killed / "feedback.json"
    ).read_bytes()
    judged = [json.loads((f / "evaluation.json").read_text()) for f in (alone, killed)]
    assert judged[0] == line
    assert judged[0]["evaluations"] == judged[1]["evaluations"]
    assert [e["engine"] for e in line["evaluations"]] == ["rod", "chain"]
    assert make_policy("feedback", Path(line["checkpoint"])).name == "feedback"


def test_worker_that_dies_ends_the_training_in_one_line() -> None:
    with (
        pytest.raises(WorkersLost, match="run the same command again"),
        workers(2) as calls,
    ):
        list(calls(os._exit, [(1,)]))


def test_workers_end_with_the_process_that_leads_them() -> None:
    script = (
        "import os, signal\n"
        "from cell.base.campaign.processes import workers\n"
        "if __name__ == '__main__':\n"
        "    with workers(2) as calls:\n"
        "        print(*dict(calls(os.getpid, [()])).values(), flush=True)\n"
        "        os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    command = [sys.executable, "-c", script]
    # Workers hold the pipe too: it closes when the last of them has ended.
    told = subprocess.run(command, stdout=subprocess.PIPE, timeout=300, check=False)
    assert told.returncode == -signal.SIGKILL
    assert int(told.stdout) > 0


def test_second_training_in_the_same_folder_is_refused(
    monkeypatch, capsys, tmp_path
) -> None:
    monkeypatch.setattr("drivers.base.files.LOCK_TIMEOUT", 0.0)
    place = os.open(tmp_path, os.O_RDONLY)
    try:
        fcntl.flock(place, fcntl.LOCK_EX)
        said = refused(monkeypatch, capsys, "train --out", tmp_path, TINY)
    finally:
        os.close(place)
    assert "another command has been changing files here" in said
    assert list(tmp_path.iterdir()) == []
