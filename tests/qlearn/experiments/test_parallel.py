"""Sweeps: the same rows on every backend, each computed once, whatever is killed in between."""

import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor
from pathlib import Path
from typing import Any

import joblib
import psutil
import pytest

from qlearn.experiments.ablation import ablate
from qlearn.experiments.compile_ahead import parts
from qlearn.experiments.parallel import Interrupted, sweep
from tests.sweep_cases import CELLS, TINY, deadly, row, where
from tests.thoroughness import scaled

ROOT = Path(__file__).parents[3]


def computed(log: Path) -> Counter[str]:
    return Counter(log.read_text().split()) if log.exists() else Counter()


def text(rows: list[Any]) -> str:
    return json.dumps(rows)  # repr of floats, and nan equal to nan


def lines(journal: Path) -> int:
    return journal.read_bytes().count(b"\n") if journal.exists() else 0


EXPECTED = text([row(cell) | {"v": row(cell)["v"].tolist()} for cell in CELLS])


# Dask says so where the disk, or the machine, is busy
pytestmark = pytest.mark.filterwarnings(
    "ignore:Creating scratch directories is taking a surprisingly long:UserWarning"
)


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """A client of two worker processes, in which linear algebra has two threads."""
    import dask
    from distributed import Client, LocalCluster

    options = {"threads_per_worker": 1, "processes": True, "dashboard_address": ":0"}
    patient = {"distributed.comm.timeouts.connect": "60s", "distributed.comm.timeouts.tcp": "120s"}
    with dask.config.set(patient), pytest.MonkeyPatch.context() as environment:
        for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
            environment.setenv(name, "2")
        local = LocalCluster(
            n_workers=2, local_directory=str(tmp_path_factory.mktemp("dask")), **options
        )
        environment.undo()
        with local, Client(local) as client:
            yield client


def test_rows_come_in_the_order_of_the_cells() -> None:
    assert text(sweep(row, CELLS, jobs=1)) == EXPECTED
    assert text(sweep(row, CELLS, jobs=2)) == EXPECTED
    with joblib.parallel_config(backend="threading"):
        assert text(sweep(row, CELLS)) == EXPECTED


@pytest.mark.slow
def test_rows_come_in_the_order_of_the_cells_on_dask(cluster: Any) -> None:
    with joblib.parallel_config(backend="dask"):
        assert text(sweep(row, CELLS)) == EXPECTED


@pytest.mark.slow
def test_dask_is_used_and_a_cell_has_one_thread_there(cluster: Any) -> None:
    workers = set(cluster.run(os.getpid).values())
    assert len(workers) == 2
    with joblib.parallel_config(backend="dask"):
        on_dask = sweep(where, CELLS)
    assert {found["pid"] for found in on_dask} == workers
    assert all({*found["threads"]} <= {1} for found in on_dask)
    assert workers.isdisjoint({found["pid"] for found in sweep(where, CELLS, jobs=2)})


def test_processes_are_used_a_cell_has_one_thread_and_an_outer_number_is_respected() -> None:
    on_loky = sweep(where, CELLS, jobs=2)
    here = sweep(where, CELLS[:1], jobs=1)
    assert len({found["pid"] for found in on_loky} - {os.getpid()}) == 2
    assert here[0]["pid"] == os.getpid()
    assert all({*found["threads"]} <= {1} for found in on_loky + here)
    assert here[0]["threads"]
    assert {found["numba"] for found in on_loky} == {"1"}
    with joblib.parallel_config(n_jobs=1):  # an outer number is respected, and an explicit one wins
        assert {found["pid"] for found in sweep(where, CELLS[:2])} == {os.getpid()}
        assert os.getpid() not in {found["pid"] for found in sweep(where, CELLS[:2], jobs=2)}


def test_cells_in_threads_of_one_process_have_one_thread_each_and_the_limit_ends_with_the_sweep() -> (  # noqa: E501
    None
):
    script = """
import joblib
import scipy.linalg
from threadpoolctl import threadpool_info, threadpool_limits
from qlearn.experiments.parallel import sweep
from tests.sweep_cases import CELLS, where

def now():
    print(*{pool["num_threads"] for pool in threadpool_info()})

now()
for _ in range(2):
    with joblib.parallel_config(backend="threading", n_jobs=3):
        found = sweep(where, CELLS[:7], shared={"pause": 0.02})
        print(*{n for one in found for n in one["threads"]})
    now()
with threadpool_limits(1):
    now()
"""
    two = {**os.environ, "OPENBLAS_NUM_THREADS": "2", "OMP_NUM_THREADS": "2"}
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, env=two, cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["2", "1", "2", "1", "2", "1"]


def test_what_fails_is_said() -> None:
    def fails(*_: Any) -> None:
        raise RuntimeError("no part of it")

    with pytest.raises(TypeError, match=r"plain values that JSON can hold, not \{1\}"):
        sweep(row, [{"x": {1}}], jobs=1)
    for jobs in (1, 2):
        with pytest.raises(RuntimeError, match="no part of it"):
            sweep(fails, CELLS, jobs=jobs)
        with pytest.raises(RuntimeError, match="no part of it"):
            sweep(row, CELLS, jobs=jobs, ahead=lambda _: (fails,))


def test_the_costly_cells_begin_first() -> None:
    begun: list[int] = []

    def called(cell: dict[str, Any]) -> int:
        begun.append(cell["x"])
        return -cell["x"]

    assert sweep(
        called, [{"x": x} for x in (3, 1, 2, 5)], jobs=1, cost=lambda cell: cell["x"] % 5
    ) == [-3, -1, -2, -5]
    assert begun == [3, 2, 1, 5]


@pytest.mark.parametrize("jobs", [1, 2])
def test_what_goes_ahead_is_done_once_for_the_missing_rows(jobs: int, tmp_path: Path) -> None:
    journal, log = tmp_path / "journal.jsonl", tmp_path / "log"
    asked: list[int] = []

    def part() -> None:
        with log.open("a") as file:
            print("ahead", file=file)

    def ahead(missing: Iterable[Any]) -> tuple[Callable[[], None], ...]:
        asked.append(len(list(missing)))
        return (part, part) if asked[-1] else ()

    for _ in range(2):
        sweep(row, CELLS[:3], shared={"log": str(log)}, journal=journal, jobs=jobs, ahead=ahead)
    assert asked == [3, 0]
    assert log.read_text().split()[:2] == ["ahead", "ahead"]
    assert computed(log)["ahead"] == 2


def test_what_goes_ahead_of_an_ablation() -> None:
    def named(**cell: Any) -> list[str]:
        return [part.__name__ for part in parts([cell])]

    assert named(comparator="always", learner="value-iteration") == ["sweeps"]
    assert named(comparator="polytope-1-wrong", learner="value-iteration") == ["proofs", "sweeps"]
    assert named(comparator="posterior-close", learner="q-learning") == ["moves", "loops"]
    assert named(comparator="polytope", learner="policy-iteration") == ["proofs", "certificates"]
    both = [
        {"comparator": "polytope", "learner": "q-learning"},
        {"comparator": "posterior", "learner": "value-iteration"},
    ]
    for part in parts(both):
        part()


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_finished_row_is_never_computed_again(jobs: int, tmp_path: Path) -> None:
    journal, log, seen = (
        tmp_path / "of" / "mine" / "journal",
        tmp_path / "log",
        [],
    )  # in folders that are not there yet
    shared = {"log": str(log)}
    sweep(row, CELLS[:3], shared=shared, journal=journal, jobs=jobs)
    found = sweep(
        row,
        CELLS,
        shared=shared,
        journal=journal,
        jobs=jobs,
        progress=lambda *now: seen.append(now),
    )
    assert text(found) == EXPECTED
    assert seen == [(done, 8) for done in range(3, 9)]
    assert computed(log) == {f"{cell['name']}{cell['x']}": 1 for cell in CELLS}
    turned = [
        dict(reversed(cell.items())) for cell in CELLS
    ]  # the order of a cell's keys does not matter
    assert text(sweep(row, turned, shared=shared, journal=journal, jobs=jobs)) == EXPECTED
    assert lines(journal) == computed(log).total() == len(CELLS)
    sweep(row, CELLS, shared=shared, journal=journal, jobs=jobs, fresh=True)
    assert set(computed(log).values()) == {2}
    assert lines(journal) == len(CELLS)


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_cell_may_have_functions_of_its_own_and_its_row_is_known_by_what_they_are_said_to_be(
    jobs: int, tmp_path: Path
) -> None:
    def apply(cell: dict[str, Any], plus: int, function: Callable[[int], int] = abs) -> int:
        return plus + function(cell["x"])

    def rows(version: str, factor: int) -> list[Any]:
        own = {1: ({"of": version}, {"function": lambda x: factor * x})}
        how: dict[str, Any] = {"shared": {"plus": 1}, "journal": tmp_path / "journal", "jobs": jobs}
        return sweep(apply, CELLS[:4], own=lambda cell: own.get(cell["x"], (None, {})), **how)

    assert rows("one", 10) == [1, 11, 3, 4]
    assert rows("one", 20) == [1, 11, 3, 4]  # the same, it is said
    assert rows("two", 20) == [1, 21, 3, 4]
    assert lines(tmp_path / "journal") == 5
    sweep(apply, CELLS[:4], shared={"plus": 1}, journal=tmp_path / "journal", jobs=jobs)
    assert lines(tmp_path / "journal") == 6  # what has nothing of its own is looked up as ever


def test_rows_of_other_settings_and_functions_are_kept_apart(tmp_path: Path) -> None:
    journal = tmp_path / "journal"
    one = sweep(row, CELLS, journal=journal, jobs=1)
    two = sweep(row, CELLS, shared={"scale": 2.0}, journal=journal, jobs=1)
    sweep(where, CELLS[:1], journal=journal, jobs=1)
    assert two[0]["third"] == 2 * one[0]["third"]
    assert lines(journal) == 2 * len(CELLS) + 1
    assert text(sweep(row, CELLS, journal=journal, jobs=1)) == EXPECTED  # still the first


@pytest.mark.parametrize("cut", [1, 2, 9, 40])
def test_a_line_that_was_cut_short_is_computed_again(cut: int, tmp_path: Path) -> None:
    journal, log = tmp_path / "journal", tmp_path / "log"
    sweep(row, CELLS, shared={"log": str(log)}, journal=journal, jobs=1)
    whole = journal.read_bytes()
    for torn in (whole[:-cut], whole[: whole.index(b"\n") - cut]):
        log.unlink()
        journal.write_bytes(torn)
        left = torn.count(b"\n")
        assert (
            text(sweep(row, CELLS, shared={"log": str(log)}, journal=journal, jobs=1)) == EXPECTED
        )
        assert computed(log).total() == len(CELLS) - left
        assert journal.read_bytes() == whole


@pytest.mark.parametrize("bad", [b"half a line\n", b'{"key": "00"}\n', b"[1]\n"])
def test_a_journal_that_was_tampered_with_is_refused_until_it_is_emptied(
    bad: bytes, tmp_path: Path
) -> None:
    journal = tmp_path / "journal"
    sweep(row, CELLS, journal=journal, jobs=1)
    whole = journal.read_bytes()
    journal.write_bytes(whole + bad + whole)
    with pytest.raises(
        ValueError, match=r"line 9 of .* is no finished row but .*start over \(fresh\)"
    ):
        sweep(row, CELLS, journal=journal, jobs=1)
    assert journal.read_bytes() == whole + bad + whole
    assert text(sweep(row, CELLS, journal=journal, jobs=1, fresh=True)) == EXPECTED
    assert journal.read_bytes() == whole


@pytest.mark.parametrize(
    "content", [b"name,age\n", b"shopping list", b'{"key": 1}\n', b"\x00\xff\n"]
)
def test_a_file_that_is_no_journal_is_refused_and_left_as_it_is(
    content: bytes, tmp_path: Path
) -> None:
    (tmp_path / "file").write_bytes(content)
    for fresh in (False, True):
        with pytest.raises(ValueError, match="file is no journal, it begins"):
            sweep(row, CELLS, journal=tmp_path / "file", jobs=1, fresh=fresh)
    assert (tmp_path / "file").read_bytes() == content


@pytest.mark.parametrize("jobs", [1, 2])
def test_ctrl_c_keeps_what_has_finished(jobs: int, tmp_path: Path) -> None:
    def stop(done: int, total: int) -> None:
        if done == 3:
            raise KeyboardInterrupt

    journal, log = tmp_path / "journal", tmp_path / "log"
    shared = {"log": str(log), "pause": 0.02}
    with pytest.raises(Interrupted, match="after 3 of 8 rows") as caught:
        sweep(row, CELLS, shared=shared, journal=journal, jobs=jobs, progress=stop)
    whole = [
        found or expected
        for found, expected in zip(caught.value.rows, json.loads(EXPECTED), strict=True)
    ]
    assert text(whole) == EXPECTED
    before = computed(log)
    assert text(sweep(row, CELLS, shared=shared, journal=journal, jobs=1)) == EXPECTED
    assert (computed(log) - before).total() == 5


def test_kill_9_of_the_whole_run_loses_at_most_the_rows_in_flight_and_ends_its_workers(
    tmp_path: Path,
) -> None:
    journal, log = tmp_path / "journal", tmp_path / "log"
    n = scaled(16, 30)
    cells = [{"x": x, "name": "k"} for x in range(n)]
    shared = {"log": str(log), "pause": 0.05}
    code = (
        "from pathlib import Path; from qlearn.experiments.parallel import sweep; from "
        "tests.sweep_cases import row; "
        f"sweep(row, {cells!r}, shared={shared!r}, journal=Path({str(journal)!r}), jobs=2)"
    )
    with subprocess.Popen([sys.executable, "-c", code], cwd=ROOT) as child:
        while lines(journal) < 5:
            assert child.poll() is None
            time.sleep(0.01)
        workers = psutil.Process(child.pid).children(recursive=True)
        child.send_signal(signal.SIGKILL)
    kept = lines(journal)
    assert 5 <= kept < n
    deadline = time.monotonic() + 30
    while any(
        worker.is_running() and worker.status() != psutil.STATUS_ZOMBIE for worker in workers
    ):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    assert computed(log).total() - kept <= 6  # what two workers were at, and what waited for them

    seen: list[tuple[int, int]] = []
    log.unlink()
    found = sweep(
        row, cells, shared=shared, journal=journal, jobs=2, progress=lambda *now: seen.append(now)
    )
    assert text(found) == text(sweep(row, cells, jobs=1))
    assert seen[0] == (kept, n)
    assert computed(log).total() == n - kept


def test_a_journal_has_one_writer_at_a_time(tmp_path: Path) -> None:
    journal, log = tmp_path / "journal", tmp_path / "log"

    def intrude(done: int, total: int) -> None:
        code = "from pathlib import Path; from qlearn.experiments.parallel import sweep; "
        code += f"sweep(print, [], journal=Path({str(journal)!r}))"
        refused = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=False
        )
        log.write_text(refused.stderr)

    sweep(row, [], journal=journal, jobs=1, progress=intrude)
    assert f"BlockingIOError: another process is writing to {journal}" in log.read_text()
    sweep(row, [], journal=journal, jobs=1)


def test_when_a_worker_is_killed_the_next_start_computes_what_is_missing(tmp_path: Path) -> None:
    journal = tmp_path / "journal"
    shared = {"marker": str(tmp_path / "marker")}
    with pytest.raises(BrokenExecutor):
        sweep(deadly, CELLS, shared=shared, journal=journal, jobs=2)
    kept, seen = lines(journal), []
    assert 0 < kept < len(CELLS)
    found = sweep(
        deadly,
        CELLS,
        shared=shared,
        journal=journal,
        jobs=2,
        progress=lambda *now: seen.append(now),
    )
    assert found == [1, 2, 3, 4] * 2
    assert seen[0] == (kept, len(CELLS))


@pytest.mark.slow
def test_an_ablation_on_dask_is_that_of_one_process_byte_for_byte(
    cluster: Any, tmp_path: Path
) -> None:
    tiny = TINY | {"comparators": ["ensemble", "polytope"], "steps": 60}
    with joblib.parallel_config(backend="dask"):
        on_dask = ablate(**tiny, journal=tmp_path / "journal")
    here = ablate(**tiny, jobs=1)
    assert len(here) == 18
    one, other = (frame.drop(columns="seconds").to_csv(index=False) for frame in (here, on_dask))
    assert one == other
    seen: list[tuple[int, int]] = []
    again = ablate(
        **tiny,
        journal=tmp_path / "journal",
        progress=lambda done, total: seen.append((done, total)),
    )
    assert again.to_csv(index=False) == on_dask.to_csv(
        index=False
    )  # the seconds too: nothing was computed
    assert seen == [(len(here), len(here))]
