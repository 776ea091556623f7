"""Commands in the environment of README's first command, which holds no optional library."""

import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

BARE = """
import sys
sys.modules["pylibfranka"] = None
sys.modules["distributed"] = None
sys.modules["torch"] = None
sys.modules["cmaes"] = None
from cell.__main__ import main
main()
"""


def run_bare(*words: str, at: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", BARE, *words], cwd=at, capture_output=True, text=True, check=False
    )


@pytest.mark.parametrize("words", [("home",), ("jog", "--x", "1")], ids=lambda words: words[0])
def test_arm_of_the_twin_moves_without_the_robots_library(words, tmp_path: Path) -> None:
    done = run_bare(*words, at=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("moved: the gripper is at x ")


@pytest.mark.parametrize(
    "words",
    [
        ("register",),
        ("fold", "--strip", "denim", "--arm", "fci"),
        ("home", "--arm", "fci"),
        ("calibrate", "check", "--arm", "fci"),
        ("benchmark", "--cluster", "tcp://127.0.0.1:1"),
        ("train", "--policy", "feedback"),
        ("train", "--policy", "adaptive"),
    ],
    ids=lambda words: f"{words[0]} {words[-1]}",
)
def test_missing_library_is_named_with_a_command_that_installs_it(words, tmp_path: Path) -> None:
    done = run_bare(*words, at=tmp_path)
    assert done.returncode == 2, done.stderr
    modules = {"--cluster": "distributed", "feedback": "cmaes", "adaptive": "torch"}
    module = next((modules[word] for word in words if word in modules), "pylibfranka")
    line = done.stderr.splitlines()[-1]
    assert f"needs the library {module}, which is not installed here" in line
    assert f"`{sys.executable} -m pip install '{module}" in line


def test_learned_policies_decide_without_the_libraries_of_their_training(tmp_path: Path) -> None:
    script = BARE.partition("from cell")[0] + (
        "from policies.registry import make_policy\n"
        "print(make_policy('feedback').name, make_policy('adaptive').name)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == ["feedback", "adaptive"]
