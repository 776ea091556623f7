"""Several folds: their order, their end, and what one that fails does to the others."""

import os
import pickle
import signal
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from multiprocessing import Pipe
from pathlib import Path

import pytest

from cell.base.campaign import processes
from cell.base.campaign.processes import Call, CallResult, PoolMessage, StopSignal
from cell.base.devices.devices import Trial
from cell.folding import batch
from cell.folding.batch import Callbacks, fold_all
from cell.folding.request import Request, repetitions
from cell.folding.result import FoldResult
from cell.orchestrator.operator import Interrupted
from drivers.base.errors import (
    CellError,
    ConfigurationError,
    Fault,
    PreflightRefused,
    SimulationNotConverged,
    SimulationNotFinite,
    Unsupported,
)
from tests.support.made_results import DONE, STOPPED, fold_by
from tests.support.requests import request_for


def repeated(runs: Path, count: int) -> tuple[Request, ...]:
    return repetitions(
        request_for("denim", "triangular", runs, trial=Trial()), [], count
    )


@pytest.mark.parametrize(
    "error",
    [
        CellError("a"),
        ConfigurationError("file: key: what"),
        PreflightRefused("no strip"),
        Fault("record", "the disk is full"),
        SimulationNotFinite("chain", 1.5),
        SimulationNotConverged("rod", 3, 1.5),
        Unsupported("rod", "wings"),
    ],
)
def test_an_error_is_the_same_in_another_process(error: CellError) -> None:
    again = pickle.loads(pickle.dumps(error))  # noqa: S301  of our own
    assert type(again) is type(error)
    assert str(again) == str(error)
    assert vars(again) == vars(error)
    assert again.exit_code == error.exit_code


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_fold_without_a_calibration_yields_its_error_and_the_others_go_on(
    tmp_path, monkeypatch, jobs: int
) -> None:
    calls = iter([ConfigurationError("calibration: refused"), None, None])

    def calibrate(*_) -> None:
        if (error := next(calls)) is not None:
            raise error

    fold_by(monkeypatch, done, calibration_of=calibrate, _fold_in_process=done)
    first, *others = fold_all(repeated(tmp_path, 3), jobs=jobs)
    assert (first.run, first.exit_code, first.reason) == ("", 2, "calibration: refused")
    assert others == [DONE, DONE]


def done(*_) -> FoldResult:
    return DONE


def test_an_error_of_a_process_is_that_fold_s_alone_and_a_process_that_dies_is_a_fault(
    tmp_path, monkeypatch
) -> None:
    monkeypatch.setattr(batch, "calibration_of", lambda *_: None)
    short, dies = (
        replace(r, policy=name)
        for r, name in zip(repeated(tmp_path, 2), "xy", strict=True)
    )
    monkeypatch.setattr(batch, "_fold_in_process", die_or_refuse)
    refused, died, again = fold_all([short, dies, short], jobs=2)
    assert [(end.exit_code, end.reason) for end in (refused, again)] == [
        (2, "x: refused")
    ] * 2
    assert (died.outcome, died.exit_code) == ("process_died", 4)
    assert "-9" in died.reason


def die_or_refuse(request: Request, _calibration, _stop) -> CellError:
    if request.policy == "y":
        os.kill(os.getpid(), signal.SIGKILL)
    return ConfigurationError("x: refused")


def test_a_fold_in_a_process_is_asked_to_stop_and_then_to_stop_at_once() -> None:
    ours, theirs = Pipe()
    told = StopSignal(theirs)
    assert not told()
    ours.send(PoolMessage.STOP)
    assert told()
    assert told()
    ours.send(PoolMessage.STOP)
    with pytest.raises(KeyboardInterrupt):
        told()


def test_a_fold_whose_master_died_stops() -> None:
    ours, theirs = Pipe()
    told = StopSignal(theirs)
    theirs.send(PoolMessage.READY)  # which nobody read any more
    ours.close()
    assert told()
    assert told()


class Fake:
    """A process whose folds end when they are looked for, in the order in which `ends`
    has them.
    """

    ends: list[int]
    log: list[tuple[str, object]]
    made: dict[int, FoldResult | CellError]

    def __init__(self, *_) -> None:
        self.pipe, self._theirs = Pipe()

    def send(self, message: Call | PoolMessage) -> None:
        if isinstance(message, PoolMessage):
            self.stop()
            return
        self._number, self._told = message.arguments[0].trial.seed, False
        self.log.append(("begin", self._number))
        if self.ends is None or self.ends[:1] == [self._number]:
            self._end()

    def _end(self) -> None:
        self._theirs.send(self._number)

    def receive(self) -> CallResult:
        number = self.pipe.recv()
        made = self.made.get(number, replace(DONE, seed=number))
        return CallResult(STOPPED if self._told else made)

    def stop(self) -> None:
        self.log.append(("stop", self._number))
        if not self._told:
            self._told = True
            self._end()

    def close(self, _patience: float) -> None:
        """Nothing to wait for."""


@pytest.fixture
def fake(monkeypatch) -> type[Fake]:
    class Fresh(Fake):
        ends, log, made = None, [], {}

    monkeypatch.setattr(processes, "Child", Fresh)
    monkeypatch.setattr(batch, "calibration_of", lambda *_: None)
    return Fresh


def attended(interrupted: Callable[[], bool]) -> Callbacks:
    return Callbacks(interrupt=lambda: nullcontext(interrupted))


def test_ctrl_c_stops_the_folds_under_way_and_begins_no_other(fake, tmp_path) -> None:
    fake.ends = []
    asked = iter([False, False])
    callbacks = attended(lambda: next(asked, True))
    assert [*fold_all(repeated(tmp_path, 5), 2, None, callbacks)] == [STOPPED, STOPPED]
    assert [number for word, number in fake.log if word == "begin"] == [0, 1]
    # no success, 130
    with pytest.raises(Interrupted, match="before all folds had begun"):
        list(fold_all(repeated(tmp_path, 5), 2, None, attended(lambda: True)))


def test_a_second_ctrl_c_is_passed_on_and_the_ends_are_still_waited_for(
    fake, tmp_path
) -> None:
    pressed = iter([False, True, None])

    def interrupted() -> bool:
        word = next(pressed, True)
        if word is None:
            raise KeyboardInterrupt
        return word

    fake.ends, fake.stop = [], stubborn(fake.stop)
    made = [*fold_all(repeated(tmp_path, 3), 2, None, attended(interrupted))]
    assert made == [STOPPED, STOPPED]
    assert [word for word, _ in fake.log].count("stop") == 4


def stubborn(stop: Callable) -> Callable:
    """A fold that ends only after the second word."""

    def slow(self) -> None:
        end, self._end = self._end, lambda: None
        already = self._told
        stop(self)
        self._end = end
        if already:
            self._end()

    return slow


def test_what_fails_in_one_fold_comes_in_its_turn_and_the_others_go_on(
    fake, tmp_path
) -> None:
    fake.made[1] = Fault("record", "the disk is full")
    first, second, *others = fold_all(repeated(tmp_path, 4), jobs=2)
    assert (first.seed, second.outcome, second.reason) == (
        0,
        "record",
        "the disk is full",
    )
    assert [result.seed for result in others] == [2, 3]


@pytest.mark.parametrize(
    ("ends", "count"),
    [([(0, 0.02)] * 3, 3), ([(1, None), (0, 0.001), (0, 0.0)], 2), ([(4, 0.0)], 1)],
)
def test_series_ends_with_the_first_close_or_stopped_fold(
    monkeypatch, tmp_path, ends, count
) -> None:
    left = iter(ends)

    def fold(*_: object) -> FoldResult:
        code, offset = next(left)
        return replace(DONE, exit_code=code, edge_offset=offset, displacement=None)

    fold_by(monkeypatch, fold, with_correction=lambda request, _: request)
    assert len([*fold_all(repeated(tmp_path, 3), 2, until=0.002)]) == count
