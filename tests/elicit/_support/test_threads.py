"""Linear algebra has one thread inside a block, and as many as before afterwards.

That is so if other threads are in such a block too.
"""

import pytest

from tests.interpreter import run

TWO = {"OPENBLAS_NUM_THREADS": "2", "OMP_NUM_THREADS": "2"}
BEGIN = """
from concurrent.futures import ThreadPoolExecutor
from threadpoolctl import threadpool_info, threadpool_limits
from elicit._support.threads import one_thread

def now():
    print(*{pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"})

@one_thread
def decorated():
    now()

"""


BLOCKS = {  # each leaves things as it found them, so that the next one begins with two threads
    "now()\ndecorated()\nnow()": "2 1 2",
    "with one_thread:\n    with one_thread:\n        now()\n    decorated()\n    now()\nnow()": (
        "1 1 1 2"
    ),
    "try:\n    with one_thread:\n        1 / 0\nexcept ZeroDivisionError:\n    now()": "2",
    "with threadpool_limits(1):\n    decorated()\n    now()\nnow()": "1 1 2",
    "with one_thread: pass\nwith threadpool_limits(1):\n    now()\nnow()\ndecorated()\nnow()": (
        "1 2 1 2"
    ),
    "import scipy.optimize, clarabel, sys\nassert len(threadpool_info()) > 1\ndecorated()": "1",
}


SEVERAL_THREADS = """
with ThreadPoolExecutor(1) as first, ThreadPoolExecutor(1) as second:
    for _ in range(2):
        first.submit(one_thread.__enter__).result()
        second.submit(one_thread.__enter__).result()
        first.submit(one_thread.__exit__, None, None, None).result()
        second.submit(now).result()
        second.submit(one_thread.__exit__, None, None, None).result()
        now()
    with threadpool_limits(2):  # by a thread that holds the limit, while another one computes
        first.submit(decorated).result()
        now()
now()
"""


@pytest.fixture(scope="module")
def shown() -> list[str]:
    """Return what each block prints, and what several threads print, in one process."""
    parts = [BEGIN, *BLOCKS, SEVERAL_THREADS]
    return [part.strip() for part in " ".join(run("\nprint('|')\n".join(parts), **TWO)).split("|")]


def test_a_block_has_one_thread_and_leaves_as_many_as_there_were(shown: list[str]) -> None:
    assert shown[:-1] == ["", *BLOCKS.values()]


def test_the_last_of_several_threads_to_leave_lifts_the_limit(shown: list[str]) -> None:
    """OpenBLAS has one limit for the process, and threadpoolctl lets only the thread that set it
    lift it.
    """
    assert shown[-1] == "1 2 1 2 1 2 2"
