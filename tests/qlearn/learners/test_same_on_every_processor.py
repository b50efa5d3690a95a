"""The same questions on every processor, and after a restart: none twice."""

import re

import pytest

from elicit.model.pairs import same_pairs
from elicit.model.scale import tail_sums
from tests import older_processor
from tests.interpreter import run
from tests.processor_cases import Run, report, resumed, runs


def test_an_older_processor_asks_the_same() -> None:
    here = report()
    code = "from tests.processor_cases import report; print(*report(), sep='\\n')"
    there = run(code, **older_processor.environment(), ELICIT_COMPILE_FIRST="")
    assert there == here
    assert len(here) == 14
    assert [line for line in here if ", 0 again," not in line] == []
    assert sum(int(re.findall(r": (\d+) ", line)[0]) for line in here) > 150


@pytest.mark.parametrize("case", [case for case in runs() if not re.search("batch|audit|Q-learning", case.name)], ids=str)
def test_a_run_that_is_resumed_asks_what_it_would_have_asked(case: Run) -> None:
    """Batches are left out, for half of them may cut one in two, and Q-learning, which begins its steps anew."""
    undisturbed, rest = resumed(case)
    if "value iteration" in case.name:  # it begins its sweeps anew: it may ask less, but nothing twice
        assert len(rest) <= len(undisturbed)
        return
    assert len(rest) == len(undisturbed) > 1
    for one, other in zip(undisturbed, rest, strict=True):
        assert same_pairs(tail_sums(one.query.d), tail_sums(other.query.d)[None]) == [1]
