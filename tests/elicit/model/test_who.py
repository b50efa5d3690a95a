"""The name of the person is a part of an answer, wherever answers go."""

import io
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from elicit import Answer, Answers, Query, Verdict
from tests.thoroughness import examples

LEFT, RIGHT = [0.1, 0.2, 0.7], [0.3, 0.3, 0.4]
NAMES = st.lists(st.sampled_from([None, "ann", "ben, the second", 'a "quoted" name']), max_size=8)


def told(who):
    d = np.arange(3 * len(who), dtype=float).reshape(len(who), 3) / 7
    return Answers(d, np.ones(len(who), int), who=who)


def test_an_answer_is_of_the_person_that_its_query_asks_unless_it_says_otherwise():
    plain, asked = Query("q", LEFT, RIGHT), Query("q", LEFT, RIGHT, who="ann")
    assert [Answer(q, 1).who for q in (plain, asked)] == [None, "ann"]
    assert Answer(asked, Verdict.WORSE, who="ben").who == "ben"
    assert Answers.of([Answer(plain, 1), Answer(asked, None), Answer(asked, 0)], 3).who == (
        None,
        "ann",
    )


@pytest.mark.parametrize(
    ("who", "kind", "says"), [(3, TypeError, "not 3"), ("  ", ValueError, "must not be empty")]
)
def test_a_person_is_a_name(who, kind, says):
    with pytest.raises(kind, match=says):
        Answer(Query("q", LEFT, RIGHT), 1, who=who)
    with pytest.raises(kind, match=says):
        Query("q", LEFT, RIGHT, who=who)
    with pytest.raises(kind, match=says):
        Answers([LEFT], [1], who=[who])


def test_there_is_one_name_a_row():
    with pytest.raises(ValueError, match=r"one name, or None, a row of d: 2 rows, but who is 'an'"):
        Answers([LEFT, RIGHT], [1, 1], who="an")
    with pytest.raises(ValueError, match="1 rows"):
        Answers([LEFT], [1], who=["ann", "ben"])


@examples(25)
@given(NAMES, NAMES)
def test_names_go_where_their_rows_go(first, second):
    both = told(first) + told(second)
    names = (*first, *second)
    assert both.who == names
    assert pickle.loads(pickle.dumps(both)).who == names
    assert both[1:].who == names[1:]
    rows = list(range(len(both)))[::-2]
    assert both.take(rows).who == tuple(names[row] for row in rows)
    assert (both.take(rows).d == both.d[rows]).all()
    for name in {*names}:
        assert both.of_person(name).ids == tuple(
            i for i, who in zip(both.ids, names, strict=True) if who == name
        )
    if first:
        ids = [f"{i}" for i in range(len(names))]
        named = Answers(both.d, both.y, ids, both.who)
        assert named.without(["0"]).who == names[1:]
    text = io.StringIO()
    both.to_csv(text)
    assert ("who" in text.getvalue().splitlines()[0]) == any(names)
    assert Answers.from_csv(io.StringIO(text.getvalue())).who == names


def test_a_table_without_names_is_as_it_was():
    text = io.StringIO()
    Answers([[0.5, 0.0, -0.5]], [1], ["a"]).to_csv(text)
    assert text.getvalue() == "id,d_1,d_2,d_3,answer\r\na,0.5,0.0,-0.5,1\r\n"


def test_one_person_s_answer_to_a_question_is_left_out():
    d = np.arange(9, dtype=float).reshape(3, 3) / 7
    answers = Answers(d, [1, 1, -1], ["q1", "q1", "q2"], ["ann", "ben", "ann"])
    assert answers.without(["q1"]).ids == ("q2",)
    assert answers.without(["q1"], who="ben").who == ("ann", "ann")
    with pytest.raises(ValueError, match="no answer of 'ben' here has the id 'q2'"):
        answers.without(["q2"], who="ben")
