"""Questions, answers, policies and bounds are the same with any number of BLAS threads.

They are the same in every process, too."""

import pytest

from tests.compile_cases import LEARNERS
from tests.interpreter import run

FEW = ["policy iteration"]


@pytest.mark.slow
@pytest.mark.parametrize(
    "learners",
    [pytest.param(FEW, id="few"), pytest.param([*LEARNERS], id="all", marks=pytest.mark.slow)],
)
def test_one_thread_or_two_and_whatever_order_python_has_for_its_sets(learners: list[str]) -> None:
    code = f"from tests.thread_cases import report; print(*report({learners!r}), sep='\\n')"
    one, two = (
        run(code, OPENBLAS_NUM_THREADS=threads, OMP_NUM_THREADS=threads, PYTHONHASHSEED=threads)
        for threads in "12"
    )
    assert len(one) == 3 * len(learners) + 4
    assert two == one
