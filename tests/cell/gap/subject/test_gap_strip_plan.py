"""`cell gap plan`: which runs it makes, and that one of them folds through images."""

import json

from cell.base.config.places import find_configs
from cell.setup.arm.run_settings import at_speed
from policies.experiments.standard import STANDARD
from tests.support.commands import run
from tests.support.refusals import refusal


def test_a_speed_beyond_the_limits_is_refused() -> None:
    settings = find_configs(None).cell()
    assert at_speed(settings, 0.05).fold.speed == 0.05
    assert at_speed(settings, None) is settings
    with refusal(r"fold: speed"):
        at_speed(settings, 1.0)


def test_the_command_says_what_it_would_do(tmp_path, monkeypatch, capsys) -> None:
    words = f"gap plan --strip denim --dry-run --runs {tmp_path}/runs"
    printed = []
    for form in ("", "--json"):
        assert run(monkeypatch, words, form) == 0
        printed.append(capsys.readouterr().out.splitlines())
    lines, rows = printed[0], [*map(json.loads, printed[1])]
    assert len(lines) == len(rows) == len(STANDARD) + 2
    assert lines[0].split()[1] == lines[-1].split()[1] == rows[-1]["name"] == "normal"
    assert not (tmp_path / "runs").exists()
