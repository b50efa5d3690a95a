"""A log says whose its answers are, and another person does not go on with it."""

import pytest

from elicit import (
    Answer,
    AnswerLog,
    BadLog,
    PolytopeComparator,
    Query,
    ReplayTutor,
    Session,
    choose,
    merge_logs,
)

LEFT, RIGHT = [0.1, 0.2, 0.7], [0.3, 0.3, 0.4]


def query(id="q", who=None):
    return Query(id, LEFT, RIGHT, who=who)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "log"


def test_a_log_of_one_person_names_them_in_every_answer(path):
    with AnswerLog(path, who="ann") as log:
        log.append(Answer(query("a"), 1))
        log.append(Answer(query("b"), 0, who="ann"))
        with pytest.raises(ValueError, match="an answer of 'ben' cannot be logged as one of 'ann'"):
            log.append(Answer(query("c"), 0, who="ben"))
    read = AnswerLog.read(path)
    assert (read.who, read.answers().who) == ("ann", ("ann", "ann"))
    with AnswerLog(path) as again:  # whoever does not say goes on as that person
        again.append(Answer(query("c"), -1))
        assert again[-1].answer.who == "ann"


def test_a_log_of_another_person_is_refused_and_stays_as_it_is(path):
    with AnswerLog(path, who="ann") as log:
        log.append(Answer(query(), 1))
    before = path.read_bytes()
    with pytest.raises(
        BadLog, match=r"holds the answers of 'ann', not of 'ben'\. Keep the answers"
    ):
        AnswerLog(path, who="ben")
    with pytest.raises(BadLog, match="not of 'ben'"):
        Session(lambda known: choose([LEFT, RIGHT], PolytopeComparator(3)), path, who="ben")
    assert path.read_bytes() == before
    AnswerLog(path, who="ann").close()


def test_a_log_that_names_nobody_is_anybodys_but_not_once_somebody_answered(path):
    with AnswerLog(path) as log:
        log.append(Answer(query("a"), 1))
    assert b"who" not in path.read_bytes()
    with AnswerLog(path, who="ann") as log:
        log.append(Answer(query("b"), 1, who="ann"))
    assert AnswerLog.read(path).answers().who == (None, "ann")
    with pytest.raises(BadLog, match="of 'ann', not of 'ben'"):
        AnswerLog(path, who="ben")


def test_a_line_written_with_a_name_beside_it_says_who_answered(path):
    with AnswerLog(path) as log:
        log.append(Answer(query("a"), 1), who="ann")  # as sessions always did
        log.append(Answer(query("b"), 1), who={"team": 3})  # any other note stays one
        with pytest.raises(ValueError, match="cannot be logged"):
            log.append(Answer(query("c"), 1, who="ann"), who="ben")
    assert [entry.answer.who for entry in AnswerLog.read(path)] == ["ann", None]


def test_merged_logs_say_whose_each_answer_is(tmp_path):
    for name in ("ann", "ben"):
        with AnswerLog(tmp_path / name, who=name) as log:
            log.append(Answer(query(), 1))
    logs = [AnswerLog.read(tmp_path / name) for name in ("ann", "ben")]
    merge_logs(logs, tmp_path / "both")
    both = AnswerLog.read(tmp_path / "both")
    assert (both.who, both.answers().who) == (None, ("ann", "ben"))
    merge_logs(logs[:1], tmp_path / "one")
    assert AnswerLog.read(tmp_path / "one").who == "ann"


def test_a_replay_gives_each_person_their_own_answers():
    said = [Answer(query("1"), 1, who="ann"), Answer(query("2"), -1, who="ben")]
    tutor = ReplayTutor(said)
    found = [tutor(query(f"new {who}", who)) for who in ("ben", "ann")]
    assert [(answer.verdict, answer.who) for answer in found] == [(-1, "ben"), (1, "ann")]
    with pytest.raises(LookupError):
        tutor(query("new", "cher"))


def test_a_replay_tells_people_with_the_same_query_ids_apart():
    said = [Answer(query("q"), 1, who="ann"), Answer(query("q"), -1, who="ben")]
    for order in (("ann", "ben"), ("ben", "ann")):
        tutor = ReplayTutor(said)
        found = {who: tutor(query("q", who)) for who in order}
        assert {who: found[who].verdict for who in order} == {"ann": 1, "ben": -1}
        assert all(found[who].who == who for who in order)
    with pytest.raises(LookupError, match="no answer by 'cher' to query q"):
        tutor(query("q", "cher"))
    # a query that names nobody gets the answers of all, in the order of the log
    tutor = ReplayTutor(said)
    found = [tutor(query("q")) for _ in range(3)]
    assert [(answer.verdict, answer.who) for answer in found] == [
        (1, "ann"),
        (-1, "ben"),
        (-1, "ben"),
    ]


def test_a_replay_repeats_a_persons_own_answers():
    said = [
        Answer(query("q"), verdict, who=who)
        for verdict, who in [(1, "ann"), (-1, "ben"), (0, "ann"), (1, "ben")]
    ]
    tutor = ReplayTutor(said)
    asked = ["ann", "ben", "ann", "ann", "ben", "ben"]
    assert [tutor(query("q", who)).verdict for who in asked] == [1, -1, 0, 0, 1, 1]


def test_two_people_may_be_asked_about_other_vectors_under_one_id():
    other = Query("q", RIGHT, LEFT, who="ben")
    tutor = ReplayTutor([Answer(query("q"), 1, who="ann"), Answer(other, 1)])
    assert tutor(query("q", "ann")).verdict == 1
    flipped = tutor(query("new", "ben"))
    assert (flipped.verdict, flipped.who, flipped.swapped) == (-1, "ben", True)


def test_what_a_session_is_told_and_what_it_reads_again_are_the_same(path):
    def make(known):
        return choose([[0.1, 0.8, 0.1], [0.5, 0.0, 0.5]], PolytopeComparator(3), known=known)

    with Session(make, path, who="ann") as session:
        asked = session.question()
        session.answer(asked.id, 1)
        now = session.current_asker().comparator.answers
    with Session(make, path) as again:
        assert again.who == "ann"
        assert again.current_asker().comparator.answers.who == now.who == ("ann",)
