"""Several folds: their order, their end, and what one that fails does to the others."""

import pickle
import shutil
from collections.abc import Callable
from dataclasses import replace
from multiprocessing import Pipe
from pathlib import Path

import pytest

import cell.folding.batch
from cell.campaign.worker import Stop, StopSignal
from cell.config.places import CHECKOUT_CONFIGS
from cell.devices.devices import DeviceSelection
from cell.folding.batch import Worker, check_requests, requests, side_by_side
from cell.folding.fold import Request
from cell.folding.result import FoldResult
from drivers.errors import (
    CellError,
    ConfigurationError,
    Fault,
    PreflightRefused,
    SimulationNotConverged,
    SimulationNotFinite,
    Unsupported,
)
from tests.support.made_results import DONE, STOPPED


def request(runs: Path, **changes) -> Request:
    facts = {"frames": None, "truth": True, "viz": "off", "configs": None, "checkpoint": None}
    facts |= {
        "strip": "denim",
        "policy": "triangular",
        "choice": DeviceSelection(seed=10),
    } | changes
    return Request(runs=runs, **facts)


def test_seeds_count_on_over_plants_and_repeats(tmp_path) -> None:
    plants = [Path("a.yaml"), Path("b.yaml")]
    folds = requests(request(tmp_path), plants, repeat=2)
    assert [fold.choice.plant for fold in folds] == [plants[0], plants[0], plants[1], plants[1]]
    assert [fold.choice.seed for fold in folds] == [10, 11, 12, 13]
    assert [fold.choice.index for fold in folds] == [0, 1, 0, 1]


def test_folds_of_a_batch_are_of_the_files_that_it_began_with(tmp_path) -> None:
    configs = Path(shutil.copytree(CHECKOUT_CONFIGS, tmp_path / "configs"))
    wanted = check_requests(requests(request(tmp_path, configs=configs), [], repeat=2))
    for path in (configs / "cell.yaml", configs / "strips" / "denim.yaml"):
        path.write_text("schema: 1\nname: of another fold\n")
    cell, strip = pickle.loads(pickle.dumps(wanted[1])).read_files()  # noqa: S301  of our own
    assert (cell.name, strip.name) == ("twin-cell", "denim")


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


def test_an_error_of_a_process_is_raised_here(tmp_path) -> None:
    wrong = request(tmp_path / "runs", strip="silk")
    with pytest.raises(ConfigurationError, match="silk"):
        list(side_by_side([wrong, wrong], jobs=2))
    assert not (tmp_path / "runs").exists()


def test_a_process_that_dies_is_a_fault() -> None:
    worker = Worker()
    worker._child.kill()
    worker.begin_fold(0, request(Path("runs")), None)
    died = worker.fold_result()
    worker.release()
    worker.join()
    assert isinstance(died, Fault)
    assert (died.name, died.exit_code) == ("process_died", 4)
    assert "-9" in died.reason


def test_a_fold_in_a_process_is_asked_to_stop_and_then_to_stop_at_once() -> None:
    ours, theirs = Pipe()
    told = StopSignal(theirs)
    assert not told()
    ours.send(Stop())
    assert told()
    assert told()
    ours.send(Stop())
    with pytest.raises(KeyboardInterrupt):
        told()


def test_a_fold_whose_master_died_stops() -> None:
    ours, theirs = Pipe()
    told = StopSignal(theirs)
    ours.close()
    assert told()
    assert told()


class Fake:
    """A worker whose folds end when they are looked for, in the order in which `ends` has them."""

    ends: list[int]
    log: list[tuple[str, object]]
    made: dict[int, FoldResult | CellError]

    def __init__(self) -> None:
        self.pipe, self._theirs = Pipe()
        self.task: int | None = None
        self._told = False

    def begin_fold(self, number: int, request: Request, calibration: object) -> None:
        self.task, self._told = number, False
        self.log.append(("begin", number))
        if self.ends and number == self.ends[0]:
            self._end()

    def _end(self) -> None:
        self._theirs.send(self.task)

    def fold_result(self) -> FoldResult | CellError:
        number, self.task = self.pipe.recv(), None
        return STOPPED if self._told else self.made.get(number, replace(DONE, seed=number))

    def stop(self) -> None:
        if self.task is not None:
            self.log.append(("stop", self.task))
            if not self._told:
                self._told = True
                self._end()

    def release(self) -> None:
        self.log.append(("release", self.task))

    def join(self) -> None:
        """Nothing to wait for."""


@pytest.fixture
def fake(monkeypatch) -> type[Fake]:
    class Fresh(Fake):
        ends, log, made = [], [], {}

    monkeypatch.setattr(cell.folding.batch, "Worker", Fresh)
    return Fresh


def ending_all(fake: type[Fake]) -> None:
    """Every fold ends at once."""
    begin = fake.begin_fold

    def ended(self, *task) -> None:
        begin(self, *task)
        self._end()

    fake.begin_fold = ended


def test_results_come_in_the_order_of_the_requests(fake, tmp_path) -> None:
    ending_all(fake)
    wanted = requests(request(tmp_path), [], repeat=5)
    assert [result.seed for result in side_by_side(wanted, jobs=2)] == [0, 1, 2, 3, 4]


def test_no_more_workers_than_folds(fake, tmp_path) -> None:
    ending_all(fake)
    list(side_by_side(requests(request(tmp_path), [], repeat=2), jobs=50))
    assert [word for word, _ in fake.log].count("release") == 2


def test_ctrl_c_stops_the_folds_under_way_and_begins_no_other(fake, tmp_path) -> None:
    wanted = requests(request(tmp_path), [], repeat=5)
    asked = iter([False, False])
    results = list(side_by_side(wanted, 2, lambda: next(asked, True)))
    assert results == [STOPPED, STOPPED]
    begun = [number for word, number in fake.log if word == "begin"]
    assert begun == [0, 1]


def test_a_second_ctrl_c_is_passed_on_and_the_ends_are_still_waited_for(fake, tmp_path) -> None:
    pressed = iter([False, True, None])

    def interrupted() -> bool:
        word = next(pressed, True)
        if word is None:
            raise KeyboardInterrupt
        return word

    fake.stop = stubborn(fake.stop)
    wanted = requests(request(tmp_path), [], repeat=3)
    assert list(side_by_side(wanted, 1, interrupted)) == [STOPPED]
    assert [word for word, _ in fake.log].count("stop") == 2


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


def test_what_fails_in_one_fold_is_raised_in_its_turn_and_everybody_is_let_go(
    fake, tmp_path
) -> None:
    ending_all(fake)
    fake.made = {1: Fault("record", "the disk is full")}
    results = side_by_side(requests(request(tmp_path), [], repeat=4), jobs=2)
    assert next(results).seed == 0
    with pytest.raises(Fault, match="disk is full"):
        next(results)
    assert [word for word, _ in fake.log].count("release") == 2
