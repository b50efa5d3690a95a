"""The answer log loses nothing that it acknowledged, and says what is wrong with a file."""

import json
import os
from dataclasses import replace
from unittest.mock import MagicMock

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from elicit.model.query import Answer, Query, Verdict
from elicit.tutors import answer_log
from elicit.tutors.answer_log import AnswerLog, BadLog

LEFT, RIGHT = [0.1, 0.2, 0.7], [1 / 3, 1 / 3, 1 / 3]


def answer(name="q", verdict=Verdict.BETTER, left=LEFT, right=RIGHT, **more):
    return Answer(Query(name, left, right, more.pop("about", "")), verdict, **more)


def parts(log):
    """All that a log's entries hold, to the last bit, to be compared."""
    blank, queries = Query("", LEFT, RIGHT), [entry.answer.query for entry in log]
    rest = [replace(entry, answer=replace(entry.answer, query=blank)) for entry in log]
    return [repr(entry) for entry in rest], [
        (one.id, one.about, one.left.tobytes(), one.right.tobytes()) for one in queries
    ]


def told(**changes):
    """The line of an answer, with other fields; ... takes one out."""
    fields = {"id": "e", "left": LEFT, "right": RIGHT, "verdict": 1, "swapped": False, "about": "", "used": True}
    return json.dumps({name: value for name, value in {**fields, **changes}.items() if value is not ...})


@pytest.fixture
def path(tmp_path):
    return tmp_path / "log.jsonl"


def ids(log):
    return [entry.answer.query.id for entry in log]


def filled(path, header=None):
    log = AnswerLog(path, header=header)
    log.append(answer("a", about="ward 3 or ward 4?\nünïcödé \u2028"), time="2024-05-01T12:00:00Z")
    log.append(answer("b", None), used=False)
    log.append(answer("c", Verdict.EQUAL, swapped=True), who={"nurse": [1, 2.5, None]})
    return log


@pytest.mark.parametrize("on_disk", [True, False])
def test_what_went_in_comes_out(path, on_disk):
    path = path if on_disk else None
    log = filled(path)
    assert (len(log), log.k) == (3, 3)
    first = next(iter(log))
    assert isinstance(first.answer.verdict, Verdict)
    assert [e.answer.verdict for e in log] == [1, None, 0]
    assert [(e.used, e.answer.swapped) for e in log] == [(True, False), (False, False), (True, True)]
    assert first.answer.query.about == "ward 3 or ward 4?\nünïcödé \u2028"
    assert [e.metadata for e in log] == [{"time": "2024-05-01T12:00:00Z"}, {}, {"who": {"nurse": [1, 2.5, None]}}]
    if path is not None:
        assert parts(AnswerLog.read(path)) == parts(AnswerLog(path)) == parts(log)


def test_answers_are_the_used_and_decided_ones():
    log = AnswerLog(k=3)
    assert (len(log.answers()), log.answers().k) == (0, 3)
    for one, used in ((answer("a", -1), True), (answer("b", None), True), (answer("c"), False), (answer("d", 0), True)):
        log.append(one, used=used)
    told = log.answers()
    assert (told.ids, told.y.tolist()) == (("a", "d"), [-1, 0])
    assert told.d.tobytes() == np.tile(np.subtract(LEFT, RIGHT), 2).tobytes()


def test_an_empty_log_does_not_guess_k():
    log = AnswerLog()
    assert (log.k, list(log)) == (None, [])
    with pytest.raises(ValueError, match="give k"):
        log.answers()


@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=6, max_size=6))
@settings(max_examples=100, deadline=None)
def test_floats_survive_to_the_last_bit(numbers):
    log = AnswerLog()
    log.append(answer(left=numbers[:3], right=numbers[3:]))
    stored = next(iter(log)).answer.query
    assert np.concatenate([stored.left, stored.right]).tobytes() == np.array(numbers).tobytes()


def test_an_existing_file_of_plain_json_lines_is_continued(path):
    filled(path, header={"levels": ["bad", "fair", "good"]})
    before = path.read_bytes()
    lines = [json.loads(line) for line in before.decode("ascii").splitlines()]
    assert lines[0] == {"format": "elicit answers", "version": 1, "k": 3, "levels": ["bad", "fair", "good"]}
    expected = json.loads(told(id="c", verdict=0, swapped=True))
    assert lines[3] == {**expected, "who": {"nurse": [1, 2.5, None]}}
    log = AnswerLog(path, k=3, header={"levels": ("bad", "fair", "good")})
    assert path.read_bytes() == before, "opening must not change the file"
    log.append(answer("d"))
    assert path.read_bytes().startswith(before)
    assert ids(AnswerLog.read(path)) == ["a", "b", "c", "d"]
    assert AnswerLog.read(path).header["levels"] == ["bad", "fair", "good"]


def test_a_given_k_shows_before_the_first_answer(path):
    log = AnswerLog(path, k=3)
    assert log.k == 3
    with pytest.raises(ValueError, match="3 levels, but query q is about 2"):
        log.append(answer(left=[0, 1], right=[1, 0]))
    assert len(log) == 0
    log.append(answer())
    assert AnswerLog.read(path).k == 3


WRITES = [lambda log: log.append(answer("d")), lambda log: log.retract("a", why="typo")]


@pytest.mark.parametrize("write", WRITES)
def test_a_file_cut_anywhere_in_its_last_line_keeps_the_rest(path, write):
    log = filled(path)
    before, start = log.answers().ids, len(path.read_bytes())
    write(log)
    after, data = log.answers().ids, path.read_bytes()
    for cut in range(start, len(data) + 1):
        path.write_bytes(data[:cut])
        left = after if cut >= len(data) - 1 else before  # only the line feed may be missing
        for open_log in (AnswerLog.read, AnswerLog):
            log = open_log(path)
            assert log.answers().ids == left, cut
        assert path.read_bytes() == data[:cut], "opening must not change the file"
        log.append(answer("next"))
        log.retract("c")  # either takes a torn line out of the file
        for found in (log, AnswerLog.read(path), AnswerLog(path)):
            assert found.answers().ids == (*(name for name in left if name != "c"), "next"), cut


def test_a_file_cut_anywhere_in_its_first_lines(path):
    """A crash during the very first append leaves a part of the header, or of the first answer."""
    AnswerLog(path).append(answer("a"))
    data = path.read_bytes()
    header = data.index(b"\n")
    for cut in range(len(data) + 1):
        path.write_bytes(data[:cut])
        log = AnswerLog(path)
        whole = cut >= len(data) - 1
        assert len(log) == whole
        assert log.k == (3 if cut >= header else None)
        log.append(answer("next"))
        assert ids(AnswerLog.read(path)) == (["a", "next"] if whole else ["next"]), cut


def test_garbage_at_the_end_is_torn_too(path):
    filled(path)
    whole = path.read_bytes()
    for tail in (b"\0" * 40, b'{"id": "\xc3', b"\xff\xfe"):
        path.write_bytes(whole + tail)
        log = AnswerLog(path)
        assert len(log) == 3
        log.append(answer("d"))
        assert len(AnswerLog.read(path)) == 4


@pytest.mark.parametrize("write", WRITES)
def test_each_write_is_synced(path, monkeypatch, write):
    log, real, synced = filled(path), os.fsync, []
    monkeypatch.setattr(os, "fsync", lambda n: (synced.append(os.fstat(n).st_size), real(n))[1])
    write(log)
    assert synced == [path.stat().st_size]


@pytest.mark.skipif(os.name != "posix", reason="only there a directory can be synced")
def test_the_name_of_a_new_file_is_synced(path, monkeypatch):
    synced = []
    monkeypatch.setattr(os, "fsync", lambda n: synced.append(os.fstat(n).st_ino))
    AnswerLog(path)
    assert synced == [path.parent.stat().st_ino]


def half_written(*args, **kwargs):
    """A file that takes all but the last five bytes."""
    file = open(*args, **kwargs)  # noqa: SIM115
    half = MagicMock(wraps=file)
    half.__enter__.return_value = half
    half.__exit__.side_effect = lambda *reason: file.close()
    half.write.side_effect = lambda data: file.write(data[:-5])
    return half


@pytest.mark.parametrize("write", WRITES)
@pytest.mark.parametrize("fails", ["write", "fsync"])
def test_a_failed_write_changes_nothing(path, monkeypatch, fails, write):
    log = filled(path)
    before = path.read_bytes()
    with monkeypatch.context() as patch:
        if fails == "fsync":
            patch.setattr(os, "fsync", MagicMock(side_effect=OSError(28, "No space left on device")))
        else:
            patch.setattr(answer_log, "open", half_written, raising=False)
        with pytest.raises(OSError, match=r"space|disk full"):
            write(log)
    assert path.read_bytes() == before
    assert (len(log), log.answers().ids) == (3, ("a", "c"))
    log.append(answer("d"))
    assert AnswerLog.read(path).answers().ids == ("a", "c", "d")


@pytest.mark.parametrize("write", WRITES)
def test_a_second_writer_is_noticed(path, write):
    one = filled(path)
    two = AnswerLog(path)
    one.append(answer("e"))
    with pytest.raises(BadLog, match="something else wrote"):
        write(two)
    assert two.answers().ids == ("a", "c")
    one.append(answer("f"))
    assert AnswerLog.read(path).answers().ids == ("a", "c", "e", "f")


@pytest.mark.parametrize("on_disk", [True, False])
def test_a_retracted_answer_stays_in_the_log_but_teaches_nothing(path, on_disk):
    path = path if on_disk else None
    log = filled(path)
    log.append(answer("a", Verdict.WORSE))  # the same query, told twice
    before = path.read_bytes() if on_disk else b""
    log.retract("a", who="nurse", why={"typo": True})
    log.retract("b")
    assert log.answers().ids == ("c",)
    assert ids(log) == ["a", "b", "c", "a"]
    assert [entry.retracted for entry in log] == [True, True, False, True]
    assert [entry.used for entry in log] == [False, False, True, False]
    assert next(iter(log)).metadata == {"time": "2024-05-01T12:00:00Z"}
    reason = {"who": "nurse", "why": {"typo": True}}
    assert [entry.retraction for entry in log] == [reason, {}, None, reason]
    if on_disk:
        assert path.read_bytes().startswith(before)
        assert [json.loads(line) for line in path.read_bytes()[len(before) :].splitlines()] == [
            {"retract": "a", **reason},
            {"retract": "b"},
        ]
        assert parts(AnswerLog.read(path)) == parts(AnswerLog(path)) == parts(log)


def test_what_cannot_be_retracted(path):
    log = filled(path)
    log.retract("a")
    before = path.read_bytes()
    for opened, name, more, complaint in (
        (log, "x", {}, "'x' cannot be retracted: this log has none"),
        (log, "a", {}, "'a' was retracted already"),
        *((log, "c", {field: 1}, field) for field in ("about", "retract", "used")),
        (log, "c", {"why": object()}, "plain JSON"),
        (AnswerLog.read(path), "c", {}, "opened for reading"),
        (AnswerLog(), "a", {}, "this log has none"),
    ):
        with pytest.raises(ValueError, match=complaint):
            opened.retract(name, **more)
    assert path.read_bytes() == before
    assert log.answers().ids == ("c",)


def test_readers_that_know_no_retractions_cannot_misread_one(path):
    """They demand an answer's fields in every line; and a log without retractions is what it always was."""
    log = filled(path)
    log.append(answer("d"), retract="free to use as metadata")
    assert json.loads(path.read_text().splitlines()[0])["version"] == 1
    assert [entry.metadata for entry in AnswerLog.read(path)][-1] == {"retract": "free to use as metadata"}
    log.retract("a", why="typo")
    demanded = {"id", "left", "right", "verdict", "swapped", "about", "used"}
    assert demanded.isdisjoint(json.loads(path.read_text().splitlines()[-1]))


@given(st.lists(st.tuples(st.sampled_from("abc"), st.sampled_from([-1, 0, 1, None, "retract"])), max_size=12))
@settings(max_examples=60, deadline=None)
def test_retractions_against_a_list(tmp_path_factory, history):
    """Any history, also after a restart at each step, against the plain list of what stands."""
    path = tmp_path_factory.mktemp("log") / "log.jsonl"
    stands: list[tuple[str, int | None]] = []
    for name, verdict in history:
        log = AnswerLog(path, k=3)
        if verdict != "retract":
            log.append(answer(name, verdict))
            stands.append((name, verdict))
        elif any(told == name for told, _ in stands):
            log.retract(name)
            stands = [one for one in stands if one[0] != name]
        else:
            with pytest.raises(ValueError, match="retracted"):
                log.retract(name)
        for found in (log, AnswerLog(path, k=3)):
            assert [(e.answer.query.id, e.answer.verdict) for e in found if not e.retracted] == stands
            told = found.answers()
            assert list(zip(told.ids, told.y.tolist(), strict=True)) == [s for s in stands if s[1] is not None]


def test_reading_does_not_write(tmp_path, path):
    filled(path)
    log = AnswerLog.read(path)
    with pytest.raises(ValueError, match="opened for reading"):
        log.append(answer("d"))
    for open_log, missing in ((AnswerLog.read, tmp_path / "none"), (AnswerLog, tmp_path / "none" / "log.jsonl")):
        with pytest.raises(FileNotFoundError):
            open_log(missing)
    assert not (tmp_path / "none").exists()
    empty = tmp_path / "empty"
    empty.touch()
    assert len(AnswerLog.read(empty)) == 0


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("hello", "no answer log"),
        ("hello\n", "no answer log"),
        ("[1, 2]\n", "no answer log"),
        ('{"format": "other"}\n', "no answer log"),
        ('{"format": "elicit answers", "version": 2, "k": 3}\n', "version 2; this program reads version 1"),
        ('{"format": "elicit answers", "version": 1}\n', "k = None"),
        ('{"format": "elicit answers", "version": 1, "k": "3"}\n', "k = '3'"),
    ],
)
@pytest.mark.parametrize("open_log", [AnswerLog, AnswerLog.read])
def test_files_that_are_no_log(path, text, complaint, open_log):
    path.write_text(text)
    with pytest.raises(BadLog, match=complaint) as caught:
        open_log(path)
    assert caught.value.line == 1
    assert path.read_text() == text


@pytest.mark.parametrize(
    ("line", "complaint"),
    [
        ("", "damaged"),
        ("{", "damaged"),
        ("3", "no JSON object"),
        ("null", "no JSON object"),
        ('{"id": "a"', "damaged"),
        (told(left=...), "no field 'left'"),
        (told(left=[0, 1]), r"\(2,\) with \(3,\)"),
        (told(left=[0, 1], right=[1, 0]), "2 levels, but its header says k = 3"),
        (told(left=[0, 1, None]), "finite|number"),
        (told(left=[0, 1, float("nan")]), "finite"),
        (told(left="abc"), "abc"),
        (told(verdict=2), "verdict is 2"),
        (told(verdict=True), "verdict is True"),
        (told(verdict="better"), "verdict is 'better'"),
        (told(used=1), "used is 1"),
        (told(swapped=None), "swapped is None"),
        (told(id=7), "id is 7"),
        ('{"retract": "x"}', "'x' cannot be retracted"),
        ('{"retract": "d"}', "'d' cannot be retracted"),  # only what was told before
        ('{"retract": null}', "None"),
        ('{"retract": ["a"]}', "cannot be retracted"),
        ('{"retract": "a", "id": "a"}', "no field"),  # half an answer, half a retraction
    ],
)
def test_a_damaged_line_in_the_middle(path, line, complaint):
    filled(path).append(answer("d"))
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:4], told(), lines[4], ""]))
    assert ids(AnswerLog.read(path)) == ["a", "b", "c", "e", "d"]
    path.write_text("\n".join([*lines[:4], line, lines[4], ""]))
    with pytest.raises(BadLog, match=complaint) as caught:
        AnswerLog(path)
    assert caught.value.line == 5
    assert f"line 5 of {path}" in str(caught.value)


def test_another_log_than_the_one_expected(path):
    filled(path, header={"problem": "icu"})
    for wanted, complaint in (({"k": 4}, "k = 3, not 4"), ({"header": {"problem": "ward"}}, "= 'icu', not 'ward'")):
        with pytest.raises(BadLog, match=complaint):
            AnswerLog(path, **wanted)
    assert len(AnswerLog(path, k=3, header={"problem": "icu"})) == 3


def test_bad_arguments():
    for header, complaint in (({"k": 3}, "not free fields"), ({"levels": {1, 2}}, "header must be plain JSON")):
        with pytest.raises(ValueError, match=complaint):
            AnswerLog(header=header)
    log = AnswerLog()
    for more, complaint in (
        ({"when": object()}, "metadata must be plain JSON"),
        ({"weight": float("nan")}, "metadata must be plain JSON"),
        ({"left": 3}, "left"),
    ):
        with pytest.raises(ValueError, match=complaint):
            log.append(answer(), **more)
    assert (len(log), log.k) == (0, None)


def test_a_log_is_read_like_a_list(path):
    log = AnswerLog(path)
    for name in "abc":
        log.append(answer(name))
    log.retract("b")
    assert (log[0].answer.query.id, log[-1].answer.query.id, log[1].retracted) == ("a", "c", True)
    assert [entry.answer.query.id for entry in log[1:]] == ["b", "c"]
    assert type(log[:0]) is tuple
    with pytest.raises(IndexError, match="there is no answer 3: the log has 3"):
        log[3]
    assert repr(log) == f"AnswerLog(3 answers, 1 of them retracted, k=3, path={str(path)!r})"
    assert repr(AnswerLog.read(path)).endswith(", read only)")
    assert repr(AnswerLog()) == "AnswerLog(0 answers, k=None)"
