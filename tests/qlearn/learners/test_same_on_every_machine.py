"""The same questions, answers, policies and bounds, however many threads BLAS would take, and in every process."""

from tests.interpreter import run


def test_one_thread_or_two_and_whatever_order_python_has_for_its_sets() -> None:
    code = "from tests.thread_cases import report; print(*report(), sep='\\n')"
    one, two = (
        run(code, OPENBLAS_NUM_THREADS=threads, OMP_NUM_THREADS=threads, PYTHONHASHSEED=threads) for threads in "12"
    )
    assert len(one) > 25
    assert two == one
