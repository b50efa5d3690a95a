"""Questions are the same on every processor, and after a restart: none comes twice."""

import re
from pathlib import Path

import pytest

from elicit.model.pairs import same_pairs
from tests import older_processor
from tests.interpreter import run
from tests.processor_cases import RECORD, Run, half_done, line_of, resumed, runs
from tests.scale_arithmetic import tail_sums
from tests.thoroughness import quick_first

RECORDED = RECORD.read_text(encoding="utf-8").splitlines()


@pytest.mark.parametrize(
    ("case", "recorded"),
    [pytest.param(*each, id=each[0].name) for each in zip(runs(), RECORDED, strict=True)],
)
def test_every_processor_asks_what_is_recorded(case: Run, recorded: str) -> None:
    """`make test-portable` runs this as on an older processor: see CONTRIBUTING.md."""
    assert line_of(case) == recorded


def test_what_is_recorded_are_many_questions_and_none_twice() -> None:
    assert len(RECORDED) == 14
    assert [line for line in RECORDED if ", 0 again," not in line] == []
    assert sum(int(re.findall(r": (\d+) ", line)[0]) for line in RECORDED) > 150


@pytest.mark.slow
def test_an_older_processor_asks_the_same() -> None:
    code = "from tests.processor_cases import report; print(*report(), sep='\\n')"
    there = run(code, **older_processor.environment(), ELICIT_COMPILE_FIRST="")
    assert there == RECORDED


PLANNED = [
    case
    for case in runs()
    if "iteration" not in case.name and not re.search("batch|audit|Q-learning", case.name)
]


@pytest.mark.parametrize("case", quick_first(PLANNED, 3), ids=lambda case: case.name)
def test_a_policy_iteration_that_is_resumed_asks_what_it_would_have_asked(case: Run) -> None:
    """Half of the answers of a batch or an audit would leave the other half open, so runs of these
    are left out.
    """
    undisturbed, rest = resumed(case)
    assert len(rest) == len(undisturbed) > 1
    for one, other in zip(undisturbed, rest, strict=True):
        assert same_pairs(tail_sums(one.query.d), tail_sums(other.query.d)[None]) == [1]


@pytest.mark.slow
def test_sessions_resumed_on_an_older_processor_ask_what_is_left_and_nothing_twice(
    tmp_path: Path,
) -> None:
    asked = half_done(tmp_path)
    code = (
        "from pathlib import Path; from tests.processor_cases import resumed_from; "
        f"print(*resumed_from(Path({str(tmp_path)!r})), sep='\\n')"
    )
    there = run(code, **older_processor.environment(), ELICIT_COMPILE_FIRST="")
    assert [line.split() for line in there] == [pairs[len(pairs) // 2 :] for pairs in asked]
    assert len(asked) == 12
    for pairs in asked:
        assert len(set(pairs)) == len(pairs) > 2
