"""Commands in the environment of README's first command, which holds no optional
library.
"""

import ast
import re
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions
from itertools import chain
from pathlib import Path

import pytest

from cell.setup.doctor.check import Grade
from cell.setup.doctor.machine import extras
from drivers.base.extras import FEATURES, install_line

ROOT = Path(__file__).parents[4]

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]

BARE = """
import sys
for name in ("pylibfranka", "distributed", "torch", "cmaes"):
    sys.modules[name] = None
"""


def run_bare(script: str, *words: str, at: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", f"{BARE}{script}", *words]
    return subprocess.run(command, cwd=at, capture_output=True, text=True, check=False)


def test_pages_and_program_install_the_extras_alike() -> None:
    pages = [ROOT / "README.md", *(ROOT / "runbooks").rglob("*.md")]
    text = "\n".join(page.read_text(encoding="utf-8") for page in pages)
    lines = re.findall(r"pip install [^`\n&]*-e '?\.[^`\n&]*", text)
    assert len(lines) >= 5
    for line in lines:
        extras = re.findall(r"'\.\[(\w+)\]'", line)
        ours = install_line(extras).replace(f"{ROOT}/", "").replace(str(ROOT), ".")
        assert line.replace("-q --no-compile ", "").strip() == ours
    stated = PROJECT["optional-dependencies"]
    for module, (extra, _) in FEATURES.items():
        assert any(library.startswith(module) for library in stated[extra])


def test_doctor_warns_of_no_library_that_nobody_needs(monkeypatch) -> None:
    monkeypatch.setattr("drivers.base.extras.find_spec", lambda _: None)
    check = extras()
    assert check.state is Grade.PASS
    assert "mcap (an MCAP file)" in check.found


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "module"),
    [
        ("register", "pylibfranka"),
        ("fold --strip denim --arm fci", "pylibfranka"),
        ("home --arm fci", "pylibfranka"),
        ("calibrate check --arm fci", "pylibfranka"),
        ("benchmark --cluster tcp://127.0.0.1:1", "distributed"),
        ("train --policy feedback", "cmaes"),
        ("train --policy adaptive", "torch"),
    ],
)
def test_missing_library_is_named_with_a_command_that_installs_it(
    words: str, module: str, tmp_path: Path
) -> None:
    script = "from cell.__main__ import main\nmain()"
    done = run_bare(script, *words.split(), at=tmp_path)
    assert done.returncode == 2, done.stderr
    line = done.stderr.splitlines()[-1]
    assert f"needs the library {module}, which is not installed here" in line
    assert f"`{sys.executable} -m pip install -c {ROOT}/.ci/constraints.txt -e" in line
    assert ("CPU build first" in line) == (module == "torch")


@pytest.mark.slow
def test_learned_policies_decide_without_the_libraries_of_their_training(
    tmp_path: Path,
) -> None:
    script = (
        "from policies.registry import make_policy\n"
        "print(make_policy('feedback').name, make_policy('adaptive').name)\n"
    )
    done = run_bare(script, at=tmp_path)
    assert done.stdout.split() == ["feedback", "adaptive"]


# by numba, mcap-protobuf-support, jinja2, pydantic, distributed
BROUGHT_BY_OTHERS = {"llvmlite", "protobuf", "markupsafe", "pydantic_core", "tornado"}


@pytest.mark.slow
def test_every_library_that_the_product_imports_is_stated() -> None:
    groups = [PROJECT["dependencies"], *PROJECT["optional-dependencies"].values()]
    stated = {
        re.split(r"[^\w.-]", line)[0].lower() for group in groups for line in group
    }
    found, ours = set(), {"cell", "drivers", "calibration", "policies"}
    for module in chain.from_iterable((ROOT / room).rglob("*.py") for room in ours):
        for node in ast.walk(ast.parse(module.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module:
                found.add(node.module.partition(".")[0])
            elif isinstance(node, ast.Import):
                found |= {name.name.partition(".")[0] for name in node.names}
    owners = packages_distributions()
    foreign = found - ours - set(sys.stdlib_module_names) - {"_typeshed"}
    needed = {
        name: {owner.lower() for owner in owners.get(name, [name])} for name in foreign
    }
    assert not {
        name for name, by in needed.items() if not by & (stated | BROUGHT_BY_OTHERS)
    }
