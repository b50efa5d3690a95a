"""Queries, answers and verdicts keep their meaning, and cannot be changed."""

import io
import json
import re
from decimal import Decimal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from elicit import Answer, Answers, InconsistentAnswers, Query, StaleAnswer, Verdict
from elicit.model.difference import MOST
from elicit.model.query import match, query_ids
from tests.thoroughness import examples

LEFT, RIGHT = [0.5, 0.25, 0.25], [0.25, 0.75, 0.0]


def parts(answers):
    return answers.ids, answers.y.tolist(), answers.d.tolist()


def test_verdicts():
    assert [int(v) for v in (Verdict.WORSE, Verdict.EQUAL, Verdict.BETTER, Verdict.UNKNOWN)] == [
        -1,
        0,
        1,
        2,
    ]
    assert Verdict.BETTER.flipped is Verdict.WORSE
    assert Verdict.EQUAL.flipped is Verdict.EQUAL
    assert Verdict.UNKNOWN.flipped is Verdict.UNKNOWN


def test_a_verdict_prints_as_its_name_and_is_stored_as_its_number():
    better = Verdict.BETTER
    assert str(better) == f"{better}" == f"{better:s}" == "%s" % better == "BETTER"  # noqa: UP031
    assert f"{better:>8}|{better:d}|{better:+d}" == "  BETTER|1|+1"
    assert repr(better) == "<Verdict.BETTER: 1>"
    assert json.dumps({"verdict": [better, Verdict.WORSE]}) == '{"verdict": [1, -1]}'
    file = io.StringIO(newline="")
    Answers([[1, -1, 0]], [better], ["a"]).to_csv(file)
    assert file.getvalue() == "id,d_1,d_2,d_3,answer\r\na,1.0,-1.0,0.0,1\r\n"


def test_queries_and_answers_keep_their_own_copy():
    left, y = np.array(LEFT), np.array([1], dtype=np.int8)
    query, answers = Query("q", left, RIGHT), Answers(left[None], y)
    left[0], y[0] = 9, -1
    assert query.left.tolist() == answers.d[0].tolist() == LEFT
    assert query.d.tolist() == [0.25, -0.5, 0.25]
    assert query.about == ""
    assert answers.y.tolist() == [1]
    rest = answers.without([])
    for array in (query.left, query.right, answers.d, answers.y, rest.d, rest.y):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1
    with pytest.raises(AttributeError):
        query.left = left


@pytest.mark.parametrize(
    ("left", "right", "complaint"),
    [
        ([1, 0], [1, 0, 0], r"\(2,\) with \(3,\)"),
        ([[1, 0]], [[1, 0]], r"\(1, 2\)"),
        ([1, np.nan], [1, 0], "finite"),
        ([1], [0], "k >= 2"),
        (["x", 0], [1, 0], "x"),
    ],
)
def test_bad_queries(left, right, complaint):
    with pytest.raises(ValueError, match=complaint):
        Query("q", left, right)


def test_ids_depend_on_all_that_makes_a_query():
    numbers = {Query.make("problem", number, LEFT, RIGHT).id for number in (0, 1, 10)}
    others = [("other", 0, LEFT, RIGHT), ("problem", 0, RIGHT, LEFT), ("problem", 0, LEFT, LEFT)]
    assert len(numbers | {Query.make(*one).id for one in others}) == 6
    assert (
        Query.make("problem", 0, np.array(LEFT), np.array(RIGHT), "about", ["a", "b", "c"]).id
        in numbers
    )


def test_many_ids_at_once_are_those_one_by_one():
    left, right = np.random.default_rng(0).normal(size=(2, 20, 3)) * 10.0 ** np.arange(20)[:, None]
    made = [Query.make("problem", 7 + i, left[i], right[i]).id for i in range(20)]
    assert query_ids("problem", 7, left, right) == made
    assert len({*made}) == 20


def test_a_query_is_printed_as_a_person_would_read_it():
    query = Query(
        "q",
        [0.12, 0.5, 0.38],
        [0.0, 1.0, 0.0],
        "ward: operate or wait?",
        ["critical", "stable", "well"],
    )
    assert str(query).splitlines() == [
        "ward: operate or wait?",
        "  left:  12% critical, 50% stable, 38% well",
        "  right: 100% stable",
    ]
    assert query.labels == ("critical", "stable", "well")
    assert str(Query("q", [1, 0], [0, 1])).splitlines() == [
        "Which is better, left or right?",
        "  left:  100% level 1",
        "  right: 100% level 2",
    ]
    near = Query("q", [0.5, 0.25, 0.25], [0.4999, 0.2502, 0.2499])
    assert str(near).splitlines()[2] == "  right: 49.990% level 1, 25.020% level 2, 24.990% level 3"
    hours = Query("q", [8, 0, 16.5], [0, 0, 0])
    assert str(hours).splitlines()[1:] == [
        "  left:  8 level 1, 16 level 3",
        "  right: nothing",
        "  totals differ, 24.5 and 0: level 1 is taken to be worth nothing",
    ]
    assert "50% level 1, 50% level 2" in str(Query("q", [0.5, 0.5], [0.5, 0.5]))
    for bad in (["a", "b"], "abc"):
        with pytest.raises(ValueError, match=r"labels must be 3 names, one a level, not"):
            Query("q", LEFT, RIGHT, labels=bad)


def test_answers_to_one_query():
    query = Query("q", LEFT, RIGHT)
    assert Answer(query, 1).verdict is Verdict.BETTER
    assert Answer(query, None).verdict is None
    assert Answer(query, Verdict.WORSE, swapped=True).swapped
    for bad, complaint in ((Verdict.UNKNOWN, "cannot tell apart"), (5, "5")):
        with pytest.raises(ValueError, match=complaint):
            Answer(query, bad)


def test_rows_of_answers():
    answers = Answers([[1, -1, 0], [0, 1, -1]], [1, -1], ["a", "b"])
    assert (answers.k, len(answers), answers.d.dtype, answers.y.dtype) == (
        3,
        2,
        np.float64,
        np.int8,
    )
    assert Answers([1, -1, 0], 0).y.tolist() == [0]
    assert Answers([[1, -1, 0]], [1]).ids == ("0",)
    assert Answers([[1, -1, 0]], [1], [7]).ids == ("7",)
    both = Answers.none(3) + answers + answers[1:]
    assert parts(both) == (("a", "b", "b"), [1, -1, -1], [[1, -1, 0], [0, 1, -1], [0, 1, -1]])
    # of two sums that begin alike the second must not write into the first
    sums = [both + Answers([[2, -2, 0]], [y], [str(y)]) for y in (1, -1)]
    assert [(one.ids[-1], one.y.tolist()) for one in sums] == [
        ("1", [1, -1, -1, 1]),
        ("-1", [1, -1, -1, -1]),
    ]
    assert (len(Answers.none(4)), Answers.none(4).k) == (0, 4)
    with pytest.raises(ValueError, match="3 levels, not 4"):
        Answers.none(4) + answers


@pytest.mark.parametrize(
    ("d", "y", "ids", "complaint"),
    [
        ([[1, 2, 3]], [2], None, "row 0 is 2"),
        ([[1, 2, 3]], [1, 1], None, "1 rows"),
        ([[1, 2, 3]], [1], ["a", "b"], "2 ids"),
        ([[1, 2, np.nan]], [1], None, "finite"),
        ([], [], None, r"\(0, k\)"),
    ],
)
def test_bad_answers(d, y, ids, complaint):
    with pytest.raises(ValueError, match=complaint):
        Answers(d, y, ids)


def test_answers_are_read_one_by_one():
    answers = Answers([[1, -1, 0], [0, 1, -1], [2, -2, 0]], [1, -1, 0], ["a", "b", "c"])
    d, y, name = answers[1]
    assert (d.tolist(), y, name) == ([0, 1, -1], Verdict.WORSE, "b")
    assert answers[-1].y is Verdict.EQUAL
    assert answers[np.int64(0)].id == "a"
    assert [(row.d.tolist(), row.y, row.id) for row in answers] == [
        (answers.d[i].tolist(), answers.y[i], answers.ids[i]) for i in range(3)
    ]
    assert parts(answers[::-2]) == (("c", "a"), [0, 1], [[2, -2, 0], [1, -1, 0]])
    assert list(Answers.none(3)) == []
    for bad in (3, -4):
        with pytest.raises(IndexError, match=f"there is no answer {bad}: there are 3"):
            answers[bad]
    with pytest.raises(TypeError):
        answers["a"]
    with pytest.raises(ValueError, match="read-only"):
        d[0] = 1
    assert repr(answers) == "Answers(3 answers, k=3)"


def test_gathering_answers_drops_the_undecided():
    queries = [Query(f"q{i}", LEFT, RIGHT) for i in range(3)]
    told = [
        Answer(queries[0], Verdict.WORSE),
        Answer(queries[1], None),
        Answer(queries[2], Verdict.EQUAL),
    ]
    answers = Answers.of(told, 3)
    assert parts(answers) == (("q0", "q2"), [-1, 0], [queries[0].d.tolist()] * 2)
    assert len(Answers.of([told[1]], 3)) == len(Answers.of([], 3)) == 0
    with pytest.raises(ValueError, match="q0 is about 3 levels, but the answers are about 4"):
        Answers.of(told, 4)


def test_leaving_answers_out():
    answers = Answers(
        [[1, -1, 0], [0, 1, -1], [2, -1, -1], [0, 1, -1]], [1, -1, 0, 1], ["a", "b", "c", "b"]
    )
    rest = answers.without(["b"])  # every row of that id
    assert parts(rest) == (("a", "c"), [1, 0], [[1, -1, 0], [2, -1, -1]])
    assert answers.without([]).ids == answers.ids == ("a", "b", "c", "b"), (
        "the answers themselves stay as they were"
    )
    nothing = answers.without(name for name in "abcc")
    assert (len(nothing), nothing.k, nothing.ids) == (0, 3, ())
    assert len(Answers([[1, -1, 0]], [1], [7]).without([7])) == 0
    with pytest.raises(ValueError, match="no answer here has the id 'x', 'y'"):
        answers.without(["y", "a", "x"])
    with pytest.raises(ValueError, match="'b'"):
        rest.without(["b"])
    with pytest.raises(TypeError, match=r"\['ab'\]"):
        answers.without("ab")


def test_answers_from_a_spreadsheet(tmp_path):
    path = tmp_path / "answers.csv"
    path.write_bytes(
        b"\xef\xbb\xbf Answer ,LEFT_1,Left_2,left_3,right_1,right_2,right_3,comment,ID\r\n"
        b'left,0.5,0.25,0.25,0.25,0.75,0,"fine, ""really""",first\r\n'
        b"\r\n"
        b" Right , 1 ,0,0,0,1e0,0,,second\r\n"
        b",,,,,,,,\r\n"
        b"cannot tell,1,0,0,0,1,0,,third\r\n"
        b"EQUAL,0,0,1,0,1,0,,fourth\r\n"
        b",0,0,1,0,1,0,no answer,fifth\r\n"
        b"-1.0,0.1,0,0,0.3,0,0,,sixth\r\n"
        b"+1,0,0,1,0,1,0,,\r\n"
    )
    answers = Answers.from_csv(path)
    d = [[0.25, -0.5, 0.25], [1, -1, 0], [0, -1, 1], [0.1 - 0.3, 0, 0], [0, -1, 1]]
    assert parts(answers) == (("first", "second", "fourth", "sixth", ""), [1, -1, 0, -1, 1], d)
    assert Answers.from_csv(str(path), k=3).ids == answers.ids


def test_answers_from_differences_are_named_by_their_line():
    file = io.StringIO("\n\nd_2,d_1,answer\n1,-1,better\n\n2,-2,null\n-3,3,worse\n")
    answers = Answers.from_csv(file)
    assert not file.closed
    assert parts(answers) == (("line 4", "line 7"), [1, -1], [[-1, 1], [3, -3]])
    nothing = Answers.from_csv(io.StringIO("d_1,d_2,d_3,answer"))
    assert (len(nothing), nothing.k) == (0, 3)


numbers = st.floats(-MOST, MOST)


@examples(100)
@given(
    st.lists(
        st.tuples(
            st.tuples(numbers, numbers, numbers), st.sampled_from([-1, 0, 1]), st.text('a,"\n\r é ')
        )
    )
)
def test_a_csv_reads_back_to_the_last_bit(rows):
    d = np.array([row[0] for row in rows]).reshape(-1, 3)
    answers = Answers(d, [row[1] for row in rows], [row[2] for row in rows])
    file = io.StringIO(newline="")
    answers.to_csv(file)
    file.seek(0)
    again = Answers.from_csv(file, k=3)
    assert parts(again) == parts(answers)
    assert again.d.tobytes() == answers.d.tobytes()


def test_a_csv_on_the_disk_reads_back(tmp_path):
    answers = Answers([[0.1, 0.2, -0.3], [1 / 3, -1 / 3, 0]], [1, 0], ["a", "ü"])
    answers.to_csv(tmp_path / "a.csv")
    again = Answers.from_csv(tmp_path / "a.csv")
    assert parts(again) == parts(answers)
    assert (tmp_path / "a.csv").read_text("utf-8").splitlines()[:2] == [
        "id,d_1,d_2,d_3,answer",
        "a,0.1,0.2,-0.3,1",
    ]


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "the file is empty"),
        ("\n \n", "the file is empty"),
        ("a,b\n", r"line 1 of the file must name the columns left_1.*it names a, b"),
        ("d_1;d_2;answer\n", "separated by commas; it names d_1;d_2;answer"),
        ("d_1,d_2\n", "answer, or else"),
        ("d_1,left_1,right_1,answer\n", "or else"),
        ("d_1,d_3,answer\n", "lacks the column 'd_2'"),
        ("d_1,answer\n", "lacks the column 'd_2'"),
        ("left_1,left_2,right_1,answer\n", "lacks the column 'right_2'"),
        ("d_1,d_999999999999,answer\n", "lacks the column 'd_2'"),
        ("d_0,d_1,d_2,answer\n", "names the column 'd_0': levels are counted 1, 2"),
        ("d_01,d_02,answer\n", "'d_01'"),
        ("d_1,d_2,D_1,answer\n", "names the column 'd_1' twice"),
        ("d_1,d_2,d_3,d_4,answer\n", "columns for 4 levels, not k = 3"),
        (
            "d_1,d_2,d_3,answer\n1,0,-1,left\n\n1,x,-1,left\n",
            "line 4 of the file, column 'd_2': 'x' is no number",
        ),
        ("d_1,d_2,d_3,answer\n1,0,,left\n", "line 2 of the file, column 'd_3': '' is no number"),
        (
            "d_1,d_2,d_3,answer\n1,0,inf,left\n",
            "line 2 of the file, column 'd_3': 'inf' is not finite",
        ),
        (
            "d_1,d_2,d_3,answer\n1,0,-1,2\n",
            "line 2 of the file, column 'answer': '2' is none of -1, 0, 1, left",
        ),
        ("d_1,d_2,d_3,answer\n1,0,-1,links\n", "column 'answer': 'links'"),
        ("d_1,d_2,d_3,answer\n1,0,left\n", "line 2 of the file has 3 cells, but the header has 4"),
        ("d_1,d_2,d_3,answer\n1,0,-1,left,9\n", "line 2 of the file has 5 cells"),
        ('d_1,d_2,d_3,answer\n1,"0"x,-1,left\n', "line 2 of the file is no CSV"),
    ],
)
def test_bad_csv(text, complaint):
    with pytest.raises(ValueError, match=complaint):
        Answers.from_csv(
            io.StringIO(text), k=3 if "d_3" in text and "d_1,d_3" not in text else None
        )


def test_a_csv_names_its_file(tmp_path):
    path = tmp_path / "odd.csv"
    path.write_bytes("d_1,d_2,answer\n1,-1,left,é\n".encode("latin-1"))
    with pytest.raises(ValueError, match=r"odd\.csv is not in UTF-8"):
        Answers.from_csv(path)
    path.write_text("d_1,d_2,answer\n1,-1,up\n")
    with pytest.raises(ValueError, match=r"line 2 of .*odd\.csv, column 'answer': 'up'"):
        Answers.from_csv(path)
    with pytest.raises(FileNotFoundError):
        Answers.from_csv(tmp_path / "none.csv")


def test_answers_are_matched_with_pending_queries():
    first, second = Query("1", LEFT, RIGHT), Query("2", RIGHT, LEFT)
    told = [
        Answer(second, Verdict.BETTER),
        Answer(Query("1", LEFT, RIGHT), None),
    ]  # any order; a copy will do
    assert match(iter(told), [first, second]) == tuple(told)
    assert match([], [first]) == ()
    assert not issubclass(StaleAnswer, InconsistentAnswers)


@pytest.mark.parametrize(
    ("told", "complaint"),
    [
        ([("1", LEFT, RIGHT), ("1", LEFT, RIGHT)], "two answers to one pending query: '1'"),
        ([("3", LEFT, RIGHT)], "no pending query has the id '3'"),
        ([("1", LEFT, LEFT)], "'1' is about other vectors"),
        ([("1", RIGHT, RIGHT)], "'1' is about other vectors"),
    ],
)
def test_answers_to_nothing_pending_are_stale(told, complaint):
    with pytest.raises(StaleAnswer, match=complaint):
        match([Answer(Query(*one), Verdict.BETTER) for one in told], [Query("1", LEFT, RIGHT)])


@pytest.mark.parametrize("told", [Answer(Query("1", LEFT, RIGHT), None), [Verdict.BETTER], [None]])
def test_what_is_no_answer(told):
    with pytest.raises(TypeError, match=r"into a list|is no answer: give elicit\.Answer"):
        match(told, [Query("1", LEFT, RIGHT)])


def test_percentages_of_a_side_total_a_hundred() -> None:
    query = Query("q", [0.102, 0.384, 0.514], [0.10954, 0.29674, 0.59372])
    assert str(query).splitlines()[2] == "  right: 10.9% level 1, 29.7% level 2, 59.4% level 3"
    rng = np.random.default_rng(0)
    for k in (2, 3, 7, 12):
        for _ in range(100):
            query = Query("q", *rng.dirichlet(np.full(k, 0.3), 2))
            for line in str(query).splitlines()[1:3]:
                shown = [Decimal(x) for x in re.findall(r"([\d.]+)%", line)]
                assert sum(shown) == 100
    third = str(Query("q", [1 / 3] * 3, [0.0, 0.5, 0.5])).splitlines()[1]
    assert third == "  left:  34% level 1, 33% level 2, 33% level 3"
