"""A person at the terminal: their answers are kept, and the result follows from them."""

import io
import json
import random
import re
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from elicit import AnswerLog, Bags, Interview, PolytopeComparator, Session, Verdict, Words
from elicit.person.hosts.getting_ready import SAID
from qlearn import (
    InteractivePolicyIteration,
    OrdinalMDP,
    draw_values,
    icu_sepsis,
    policy_loss,
    random_mdp,
)
from qlearn.cli.main import main
from qlearn.cli.teach_subjects import read_alternatives, taught_by
from qlearn.problems import FAMILIES
from tests.interpreter import run
from tests.scripted_person import Teach, Typing, answer_all, reads_nothing_beside, truthful
from tests.thoroughness import scaled, thorough

LEVELS = [f"level {i}" for i in range(1, 6)]
VALUES = dict(zip(LEVELS, draw_values(5, 7).tolist(), strict=True))
TABLE = "name,died,ill,well\nold,2,3,5\nnew,3,1,6\nnone,1,8,1\n"
ILL = {"died": 0.0, "ill": 0.3, "well": 1.0}


@pytest.fixture(autouse=True)
def in_a_hurry(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """In a quick run most of these persons answer before anything is computed beside a question."""
    slow_readers = (test_a_choice_from_a_csv, test_choices_of_a_conflict_say_what_each_leaves)
    if not thorough() and request.function not in slow_readers:
        reads_nothing_beside(monkeypatch)


def own(seed: int) -> tuple[OrdinalMDP, Words]:
    """A problem of a user, with his words."""
    return random_mdp(6, 2, 3, discount=0.8, seed=seed)[0], Words(
        "weeks", "go", "Mine", "What matters to me."
    )


def number(seed: int) -> int:
    """No problem."""
    return seed


class Typed(io.StringIO):
    """The input of a person who types; no terminal, unless a test says so."""


def taught(
    typed: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    *options: str,
    columns: int = 80,
) -> tuple[int, str, str]:
    """The exit code, output and errors of the command in this process, with these lines for
    input.
    """
    monkeypatch.setattr(sys, "stdin", Typed(typed))
    monkeypatch.setenv("COLUMNS", f"{columns}")
    code = main(["teach", *options])
    shown = capsys.readouterr()
    return code, shown.out, shown.err


@pytest.fixture
def lets_answer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., str]:
    """Let a truthful person answer the command, run in this process in a folder of its own; returns
    what it showed.
    """

    def answered(values: dict[str, float], *options: str) -> str:
        typing = Typing(lambda: capsys.readouterr().out, values)
        monkeypatch.setattr(sys, "stdin", typing)
        monkeypatch.setenv("COLUMNS", "80")
        assert main(["teach", *options]) == 0
        return typing.text + capsys.readouterr().out

    monkeypatch.chdir(tmp_path)
    return answered


@pytest.fixture
def table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Alternatives to choose from, in the current directory."""
    (tmp_path / "care.csv").write_text(TABLE)
    monkeypatch.chdir(tmp_path)
    return "--problem=care.csv"


def widest(log: Path) -> float:
    """The width, of 100, of the widest range of a level after the answers in a log."""
    told = taught_by("care.csv", "posterior", 10, None, 0, 0.01)
    with Session(told.make, log) as session, Interview(session, told.subject) as interview:
        scale = interview.handle({"do": "result"})["end"]["scale"]
    return max(float(row["high"] - row["low"]) for row in scale)


def test_the_values_are_the_goal_unless_only_the_result_is_wanted(
    lets_answer: Callable[..., str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    rows = "option,dead,ill,fair,well\nrest,5,30,30,35\nsurgery,10,5,10,75\npills,2,38,40,20\n"
    Path("care.csv").write_text(rows)
    table, values = "--problem=care.csv", {"dead": 0.0, "ill": 0.23, "fair": 0.71, "well": 1.0}
    shown = lets_answer(values, table, "--log", "result.jsonl", "--until", "settled")
    assert widest(Path("result.jsonl")) > 60
    assert "known only roughly" in " ".join(shown.split())
    lets_answer(values, table, "--log", "values.jsonl")
    assert widest(Path("values.jsonl")) <= 41
    # whoever goes on with a log goes on as far as before, or as far as they say now
    shown = lets_answer(values, table, "--log", "result.jsonl")
    assert "Enter: what was learned" in shown
    assert widest(Path("result.jsonl")) > 60
    options = (table, "--log", "result.jsonl", "--until", "values")
    if not thorough():
        _, shown, _ = taught("q\n", monkeypatch, capsys, *options)
        assert "Question " in shown
        assert "Enter: what was learned" not in shown
        return
    lets_answer(values, *options)
    assert widest(Path("result.jsonl")) <= 41


class Careless(io.StringIO):
    """The input of a person who answers A to everything, and leaves contradictions for later."""

    def __init__(self, shown: Callable[[], str]) -> None:
        super().__init__()
        self._shown = shown
        self.text = ""

    def readline(self, size: int | None = -1) -> str:
        """Answer what stands last; at the end, end the input."""
        since = self._shown()
        self.text += since
        later = re.search(
            r"(\d+): (Keep them all|Keep both|Keep it|Go on as before|Go on until it)", since
        )
        if later:
            return f"{later[1]}\n"
        return "" if "Enter: what was learned" in since else "a\n"


def report(shown: str) -> str:
    """Return the learned values as shown, without remarks on the speed of the answers."""
    said = shown[shown.index("There are no more questions") : shown.index("All answers are in")]
    return re.sub(r"\d+ of \d+ answers came in under a second,[^.]*\.\n", "", said)


def told(log: Path) -> list[tuple[str, Verdict | None]]:
    """The answers of a log that stand."""
    return [(e.answer.query.id, e.answer.verdict) for e in AnswerLog.read(log) if not e.retracted]


@pytest.mark.slow
@pytest.mark.parametrize(
    "comparator",
    ["polytope", "polytope-1-wrong", pytest.param("posterior", marks=pytest.mark.slow)],
)
def test_a_truthful_person_teaches_a_random_problem(comparator: str, tmp_path: Path) -> None:
    with Teach(tmp_path, "--problem", "random", "--comparator", comparator, "--seed", "3") as teach:
        keys = [key for key in answer_all(teach, VALUES) if not key.isdigit()]  # no offers
        code, errors = teach.leave()
    assert (code, errors) == (0, f"{SAID}\n")
    assert len(keys) > 3
    assert {"a", "b"} <= {*keys}  # left and right are at random
    log = AnswerLog.read(tmp_path / "answers-random.jsonl")
    mdp, _ = random_mdp(30, 3, 5, 0.9, seed=3)
    assert log.header["problem"] == mdp.fingerprint
    assert (log.k, log.header["labels"], log.header["unit"], log.header["discount"]) == (
        5,
        LEVELS,
        "days",
        0.9,
    )
    values = np.array([*VALUES.values()])
    assert len(log) == len(keys) - 1  # but for practice
    for entry, key in zip(log, keys[1:], strict=True):
        query = entry.answer.query
        assert entry.answer.verdict == np.sign(round(10 * query.d @ values))  # of whole numbers
        shown = next(asked for asked in log.asked if asked.query.id == query.id)
        said = shown.metadata["shown"]
        left, right = ("b", "a") if shown.swapped else ("a", "b")
        assert said["exact"]
        total = sum(said[left])  # 10 days, or 100 where a level is compared with a chance
        assert total in (10, 100)
        assert (np.array(said[left]) / total).tolist() == query.left.tolist()
        assert (np.array(said[right]) / total).tolist() == query.right.tolist()
        assert entry.answer.swapped == shown.swapped
        assert key == {0: "e", 1: left, -1: right}[entry.answer.verdict]
    said = report(teach.shown)
    sure = {
        "polytope": "If your answers are right",
        "polytope-1-wrong": "Even if one of your answers is wrong",
        "posterior": "With 95% probability",
    }[comparator]
    loss = (
        r"The plan comes within ([\d.]+) in 100 of your ideal plan\. .*"
        rf"How sure: {sure}, your plan falls at most \1 in 100 short of your ideal plan, .* "
        r"That is as much as if \1 in 100 days were at “level 1” instead of “level 5”\. "
    )
    bound = re.search(loss, " ".join(said.split()))
    assert bound, " ".join(said.split())
    assert float(bound[1]) == 1  # of 100, which is the tolerance
    known = PolytopeComparator(5, wrong=int(comparator == "polytope-1-wrong"))
    policy = InteractivePolicyIteration(mdp, known, bags=Bags(10), known=log).result().policy
    assert (
        comparator == "posterior" or policy_loss(mdp, policy, values).max() <= float(bound[1]) / 100
    )
    for name, value in VALUES.items():
        interval = re.search(rf"  {name} +(?:\d+|unknown)  (?:(\d+) to (\d+))?", said)
        assert interval
        low, high = (float(interval[1]), float(interval[2])) if interval[1] else (0.0, 100.0)
        true = 100 * (value - min(VALUES.values())) / (max(VALUES.values()) - min(VALUES.values()))
        assert comparator == "posterior" or low <= true <= high
    listed = differing(teach.shown)
    assert all(one != other for _, one, other in listed)


def differing(shown: str) -> list[tuple[str, str, str]]:
    """Return the states in which the policy is said to differ from that of equal gaps, with both
    actions.
    """
    found = re.search(r"In (\d+) of 30 states your answers change", " ".join(shown.split()))
    listed = re.findall(r"  - (\d+): (\d), not (\d)", shown)
    assert len(listed) == min(12, int(found[1]) if found else 0)
    return listed


def test_where_no_bags_tell_more_whole_numbers_near_the_shares_go_on(
    lets_answer: Callable[..., str], tmp_path: Path
) -> None:
    said = " ".join(
        lets_answer(
            VALUES,
            *("--problem", "random", "--seed", "3", "--tolerance", "0.001"),
            *("--comparator", "polytope"),
        ).split()
    )
    assert "There are no more questions" in said
    assert "(Rounded" not in said  # else what is certified could be untrue
    bound = re.search(r"It comes within ([\d.]+) in 100 of your ideal plan", said)
    assert bound
    assert float(bound[1]) <= 0.1
    log = AnswerLog.read(tmp_path / "answers-random.jsonl")
    near = [entry for entry in log if " of 1" in entry.answer.query.id]
    assert near
    assert all(entry.used or entry.repeat for entry in log)
    values = np.array([*VALUES.values()])
    assert all(entry.answer.verdict == np.sign(entry.answer.query.d @ values) for entry in near)
    mdp, _ = random_mdp(30, 3, 5, 0.9, seed=3)
    policy = (
        InteractivePolicyIteration(mdp, PolytopeComparator(5), bags=Bags(10), known=log)
        .result()
        .policy
    )
    assert policy_loss(mdp, policy, values).max() <= float(bound[1]) / 100


def test_a_smaller_tolerance_goes_on_where_a_greater_one_ended(
    lets_answer: Callable[..., str], tmp_path: Path
) -> None:
    answered, bounds = [0], []
    more = scaled(("--until", "settled"), ())  # not until no range is wide, too
    for tolerance in scaled(("0.1", "0.02"), ("0.05", "0.005")):
        said = " ".join(
            lets_answer(
                VALUES, "--problem", "random", "--tolerance", tolerance, "--audit", "0", *more
            ).split()
        )
        assert (f"Going on after {answered[-1]} answer" in said) == (answered[-1] > 0)
        bounds += [
            float(found) / 100
            for found in re.findall(
                r"(?:It|Your plan|The plan) comes within ([\d.]+) in 100 of your ideal plan", said
            )
        ]
        assert bounds[-1] <= float(tolerance)
        answered.append(len(told(tmp_path / "answers-random.jsonl")))
    assert 0 < answered[1] < answered[2]


@pytest.mark.slow
def test_killed_at_random_moments_nothing_is_lost_and_the_end_is_the_same(tmp_path: Path) -> None:
    with Teach(tmp_path, "--problem", "random", "--log", "whole.jsonl") as teach:
        keys = answer_all(teach, VALUES)
        teach.leave()
    undisturbed = report(teach.shown)
    chance, log, kept, repeats = random.Random(1), tmp_path / "killed.jsonl", 0, 0
    for _ in range(3):
        with Teach(tmp_path, "--problem", "random", "--log", "killed.jsonl") as teach:
            first = teach.prompted()
            assert (f"Going on after {kept} answer" in first) == (kept > 0)
            practised = int(not kept)
            acknowledged = (
                kept + len(answer_all(teach, VALUES, practised + chance.randint(0, 2))) - practised
            )
            assert teach.process.stdin is not None
            teach.process.stdin.write(
                f"{truthful(teach.since, VALUES)}\n".encode()
            )  # perhaps kept, perhaps not
            teach.process.stdin.flush()
            time.sleep(chance.uniform(0, 0.1))
        kept = len(told(log))
        repeats = sum(entry.repeat for entry in AnswerLog.read(log))
        assert acknowledged <= kept <= acknowledged + 1
    with Teach(tmp_path, "--problem", "random", "--log", "killed.jsonl") as teach:
        answer_all(teach, VALUES)
        assert teach.leave()[0] == 0
    assert report(teach.shown) == undisturbed
    assert told(log) == told(tmp_path / "whole.jsonl")
    assert len(keys) - 1 == len(told(log))
    assert repeats


def test_a_choice_from_a_csv(lets_answer: Callable[..., str], tmp_path: Path) -> None:
    (tmp_path / "care.csv").write_text(TABLE)
    shown = lets_answer(ILL, "--problem", "care.csv", "--unit", "patients", "--until", "settled")
    assert "Two groups of 10 patients: which would you rather have?" in shown
    assert re.search(
        r"of 10 patients are the same in both groups: [1-9] (well|ill|died)",
        " ".join(shown.split()),
    )
    said = " ".join(shown.split())
    assert re.search(
        r"By your answers “new” is best\. On the scale from 0 \(all “died”\) to 100 "
        r"\(all “well”\), “new” is worth [\d.]+ more ",
        said,
    )
    assert "With at least 95% probability no other alternative is better." in said
    assert "(Rounded" not in shown
    log = AnswerLog.read(tmp_path / "answers-care.jsonl")
    assert log.header["unit"] == "patients"
    assert sum(not entry.repeat for entry in log) == 5  # one would have been enough for the pairs


@pytest.mark.parametrize("total", [100, 0.5])
def test_a_bound_on_a_choice_holds_per_outcome_whatever_the_total(
    tmp_path: Path, total: float
) -> None:
    """The person calls equal whatever is less than .01 of the value range apart."""
    shares = (
        np.array(
            [[10, 21, 32, 3, 34], [13, 26, 21, 5, 35], [10, 27, 24, 7, 32], [6, 25, 33, 7, 29]]
        )
        / 100
    )
    rows = [",".join(["it", *map(str, row)]) for row in (shares * total).round(9).tolist()]
    (tmp_path / "care.csv").write_text("\n".join(["name,a,b,c,d,e", *rows]))
    values = np.array([0, 0.31, 0.34, 0.86, 1])
    care, log = taught_by(str(tmp_path / "care.csv"), "polytope", 10, None, 0, 0.01), AnswerLog()
    with Session(care.make, log) as session, Interview(session, care.subject) as interview:
        screen = interview.handle({"do": "practised", "choice": "a"})
        while question := screen["question"]:
            apart = (
                sum((row["a"] - row["b"]) * values[row["level"]] for row in question["rows"])
                / question["of"]
            )
            choice = "equal" if abs(apart) <= 0.01 else "a" if apart > 0 else "b"
            screen = interview.handle({"do": "answer", "id": question["id"], "choice": choice})
        assert screen["end"]["open"] is None
        result = session.result()
    assert log[0].answer.verdict is Verdict.EQUAL
    lost = (shares @ values).max() - (shares @ values)[result.best]
    assert 0.005 < lost <= result.loss_bound < 0.05


def test_what_a_choice_can_lose_is_the_same_of_counts_and_of_shares(tmp_path: Path) -> None:
    said = []
    for name, unit in (("counts", 100), ("shares", 1)):
        path = tmp_path / f"{name}.csv"
        rows = ((0.5, 0.0, 0.5), (0.1, 0.8, 0.1))
        path.write_text(
            "\n".join(
                [
                    "care,died,ill,well",
                    *(
                        f"{i},{','.join(f'{unit * x:g}' for x in row)}"
                        for i, row in enumerate(rows)
                    ),
                ]
            )
        )
        course = taught_by(str(path), "polytope", 10, None, 0, 0.01)
        asker: Any = course.make([])
        asker.ask()
        result = asker.result()
        concluded = course.subject.conclude(result, None)
        said.append((course.subject.stakes(result), concluded.next))
    assert said[0] == said[1]
    lost = re.search(
        r": as much as if ([\d.]+) in 100 outcomes were at “died” instead "
        r"of “well”",
        str(said[0][0]),
    )
    assert lost
    assert float(lost[1]) == pytest.approx(40, abs=1.01)  # what ill is worth is open: from 0 to 1


def test_words_for_keys_undo_and_quit(
    table: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    typed = "A\n\nwhat\n1\nequal\nu\nu\n?\nb\nundo\nquit\nnever read\n"
    code, shown, _ = taught(typed, monkeypatch, capsys, table, "--comparator", "posterior")
    assert code == 0
    assert (
        "'what' is no answer here. a or b: that one; e: equal; ?: cannot tell; u: take back; w: "
        "why; f: finish now; q: quit" in " ".join(shown.split())
    )
    assert "'1' is no answer here." in shown  # it is a number of a list, not a side
    assert shown.count("Taken back.") == 2
    assert shown.count("There is no answer to take back.") == 1
    assert "never read" not in shown
    assert shown.endswith(
        "Kept: 1 answer. To go on:\n  qlearn teach --problem care.csv --comparator posterior "
        "--log answers-care.jsonl --days 10 --seed 0 --tolerance 0.01\n"
    )
    log = AnswerLog.read("answers-care.jsonl")
    assert [(entry.answer.verdict, entry.retracted) for entry in log] == [
        (Verdict.EQUAL, True),
        (None, False),
        (log[2].answer.verdict, True),
    ]


def test_at_the_end_the_keys_of_the_end_are_said(
    table: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ("--tolerance", scaled("0.1", "0.01"))
    _, shown, _ = taught("a\n1\n" * 30, monkeypatch, capsys, table, *options)
    after = " ".join(shown[shown.index("Enter: what was learned") :].split())
    assert (
        "'1' is no answer here. Enter: what was learned; m: more questions; u: take back" in after
    )
    assert "w: why" not in after


def test_a_plan_is_said_before_the_first_question_and_ends_the_session(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ("--problem", "random", "--questions", "2", "--audit", "0", "--tolerance", ".001")
    log = f"{tmp_path / 'a.jsonl'}"
    code, shown, _ = taught("a\n" * 3 + "1\n\n", monkeypatch, capsys, *options, "--log", log)
    assert code == 0
    said = " ".join(shown.split())
    plan = "Your plan: 2 questions bounded the loss by"
    assert said.index(plan) < said.index("Question 1")
    assert "You planned 2 questions, and answered 2." in said
    assert "This is the result so far. More could be asked." in said
    assert re.search(r"So far your plan comes within \S+ in 100 of your ideal plan\.", said)
    assert "With 95% probability, your plan falls at most " in said
    assert " That is as much as if " in said
    assert "The result counts as settled below" in said
    code, shown, _ = taught("a\n" * 2 + "q\n", monkeypatch, capsys, *options, "--log", log)
    assert "You planned 4 questions, and answered 4." in " ".join(shown.split())
    with pytest.raises(SystemExit):
        main(["teach", "--questions", "0"])


MORE = (
    r"Question \d+ \((about \d+( to \d+)? more|close to the end|"
    r"probably close to the end, at most about \d+ more)\)"
)


@pytest.mark.slow
def test_why_a_question_is_asked_and_how_many_come_after_it(tmp_path: Path) -> None:
    numbers = []
    with Teach(
        tmp_path, "--problem", "random", "--seed", "3", "--tolerance", "0.005", "--audit", "0"
    ) as teach:
        teach.prompted()
        assert "It is there to try the keys." in teach.say("w")
        text = teach.say("a")
        while "Enter: what was learned" not in text:
            numbers.append(int(re.search(r"Question (\d+)", text)[1]))  # type: ignore[index]
            why = teach.say("w")
            told = "We don't yet know|So far|If the questions ended|guards against"
            while not re.search(told, " ".join(why.split())):
                assert "Still being worked out" in why
                why = teach.say("w")
            again = re.search(r"Question (\d+)", why)
            assert again
            assert int(again[1]) == numbers[-1]
            for _ in range(30):  # until the number to come was said of one question
                if re.search(MORE, teach.shown):
                    break
                time.sleep(0.1)
                why = teach.say("w")
            text = teach.say(truthful(why[why.index("Question ") :], VALUES))
        assert teach.leave()[0] == 0
    assert numbers == [*range(1, len(numbers) + 1)]
    assert re.search(MORE, teach.shown)


def test_the_end_of_the_input_quits_and_at_the_end_tells_what_was_learned(
    table: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    code, shown, _ = taught("", monkeypatch, capsys, table)
    assert code == 0
    assert "Practice question: your answer is not saved" in shown
    assert "Kept: 0 answers. To go on:" in shown
    code, shown, _ = taught("a\n" * 2, monkeypatch, capsys, table, columns=39)
    assert "Kept: 1 answer." in shown
    assert (
        max(len(line) for line in shown.splitlines() if not line.startswith("  qlearn teach")) <= 39
    )
    options = ("--tolerance", scaled("0.1", "0.01"))
    code, shown, _ = taught("a\n1\n" * 30, monkeypatch, capsys, table, *options)
    assert "Practice question: your answer is not saved" not in shown
    assert "Going on after 1 answer." in shown
    assert "Enter: what was learned" in shown
    assert "By your answers" in shown
    before = told(Path("answers-care.jsonl"))
    code, shown, _ = taught("u\nq\n", monkeypatch, capsys, table, *options)
    assert told(Path("answers-care.jsonl")) == before[:-1]


def test_the_practice_question_says_what_most_would_say(
    table: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    said = [taught(f"{key}\n", monkeypatch, capsys, table)[1] for key in "ab"]
    assert sum("That is how it works. Now the real questions." in text for text in said) == 1
    assert (
        sum(
            bool(re.search("Most people choose [AB], because everyone in it", text))
            for text in said
        )
        == 1
    )
    assert not told(Path("answers-care.jsonl"))
    slips = [re.search(r"Everyone in [AB] is “died”: perhaps", " ".join(t.split())) for t in said]
    assert sum(map(bool, slips)) == 1


def test_after_a_slip_the_practice_question_can_be_tried_again(
    table: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = "a" if "Most people choose B" in taught("a\n", monkeypatch, capsys, table)[1] else "b"
    right = "ab".replace(wrong, "")
    text = taught(f"{wrong}\nu\n{right}\nu\n", monkeypatch, capsys, table)[1]
    assert text.count("u: try again") == 1
    assert text.count("Practice question: your answer is not saved.") == 2
    assert text.count("That is how it works. Now the real questions.") == 1
    assert text.count("There is no answer to take back.") == 1  # after the right answer
    assert not told(Path("answers-care.jsonl"))


def test_ctrl_c_keeps_what_was_answered(
    table: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class Interrupted(io.StringIO):
        def readline(self, size: int | None = -1) -> str:  # type: ignore[override]
            line = super().readline()
            if not line:
                raise KeyboardInterrupt
            return line

    monkeypatch.setattr(sys, "stdin", Interrupted("a\na\n"))
    assert main(["teach", table]) == 130
    assert "Kept: 1 answer. To go on:" in capsys.readouterr().out


def test_answers_that_do_not_go_together_are_said_and_change_with_the_comparator(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    careless = "".join(f"{key}\n" for key in random.Random(2).choices("ab", k=scaled(12, 40)))
    taught(
        careless,
        monkeypatch,
        capsys,
        "--problem",
        "random",
        "--comparator",
        "posterior",
        "--audit",
        "0",
    )
    given = told(Path("answers-random.jsonl"))
    assert all(entry.used for entry in AnswerLog.read("answers-random.jsonl"))
    typing = Careless(lambda: capsys.readouterr().out)
    monkeypatch.setattr(sys, "stdin", typing)
    code = main(["teach", "--problem", "random", "--audit", "0", "--comparator", "polytope"])
    shown = typing.text + capsys.readouterr().out
    assert code == 0
    assert f"Going on after {len(given)} answers." in shown
    assert told(Path("answers-random.jsonl"))[: len(given)] == given
    unused = sum(not entry.used for entry in AnswerLog.read("answers-random.jsonl"))
    assert unused
    ignored = rf"\b{unused} (is|are) ignored for contradicting others"
    assert re.search(ignored, " ".join(shown.split()))
    conflict = [*re.finditer("These answers contradict each other. Taking back any one", shown)][-1]
    items = re.findall("^  - .*", shown[conflict.end() :], re.MULTILINE)
    assert len(items) >= 2
    assert all(" rather than " in item or " as good as " in item for item in items)


def test_choices_of_a_conflict_say_what_each_leaves(
    table: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    chance = random.Random(3)
    typed = "".join(f"{chance.choice('ab')}\n" for _ in range(60))
    _, shown, _ = taught(typed, monkeypatch, capsys, table, "--comparator", "polytope")
    said = " ".join(shown.split())
    worth = r"“ill” would be worth (about )?\d+ \(\d+ to \d+\)\."
    unused = r"\d+ answers? that you keep would not be used\."
    assert re.search(rf"1: [^:]+?\. {worth}( {unused})?", said)


def test_words_that_a_table_lacks_are_asked_for_and_written_beside_it(
    table: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(Typed, "isatty", lambda _: True)
    code, shown, errors = taught("\n" * 5 + "q\n", monkeypatch, capsys, table)
    assert code == 0
    assert "care.words.json" in errors  # nothing was said, so the hint comes
    assert not Path("care.words.json").exists()
    Path("answers-care.jsonl").unlink()
    typed = "Ann\nHip care\npatients\n\nthe hip registry\nq\n"
    code, shown, errors = taught(typed, monkeypatch, capsys, table)
    assert code == 0
    assert "Written to care.words.json, where you can change it." in shown
    assert json.loads(Path("care.words.json").read_text()) == {
        "title": "Hip care",
        "unit": "patients",
        "source": "the hip registry",
    }
    assert "Two groups of 10 patients" in shown
    assert "words.json" not in errors
    _, shown, _ = taught("Ann\nq\n", monkeypatch, capsys, table)  # once
    assert "stand for" not in shown


def test_names_in_a_file_cannot_steer_the_terminal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("x.csv").write_text(TABLE.replace("ill", "i\x1b[2Jll").replace("new", "\x1b]0;new"))
    options = ("--problem", "x.csv", "--unit", "\x1bmen", "--tolerance", scaled("0.1", "0.01"))
    code, shown, errors = taught("a\n1\n" * 30, monkeypatch, capsys, *options)
    assert code == 0
    assert "By your answers" in shown
    assert "\x1b" not in shown + errors


def test_a_problem_and_its_words_of_the_users(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    code, shown, _ = taught(
        "a\n", monkeypatch, capsys, "--problem", f"{__name__}:own", "--days", "5"
    )
    assert code == 0
    assert shown.startswith("Mine\nWhat matters to me.\n")
    assert "Two groups of 5 weeks: which would you rather have?" in shown
    code, shown, _ = taught("a\n", monkeypatch, capsys, "--problem", f"my={__name__}:own")
    assert f" --problem my={__name__}:own " in shown  # with which it goes on
    code, _, errors = taught("", monkeypatch, capsys, "--problem", f"{__name__}:number")
    assert code == 1
    assert (
        "called with seed = 0, must return an OrdinalMDP, or a tuple (mdp, elicit.Words), not 0"
        in errors
    )


def test_another_problems_log_a_log_in_use_and_no_log_are_said(
    table: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    taught("a\na\n", monkeypatch, capsys, table)
    options = ("--problem", "random", "--log", "answers-care.jsonl")
    code, shown, errors = taught("a\n", monkeypatch, capsys, *options)
    assert (code, shown) == (1, "")
    assert "qlearn: answers-care.jsonl is another log: its header says " in errors
    with AnswerLog("answers-care.jsonl"):
        code, shown, errors = taught("a\n", monkeypatch, capsys, table)
    assert (code, shown) == (1, "")
    assert "answers-care.jsonl" in errors
    code, _, errors = taught("a\n", monkeypatch, capsys, table, "--log", "/dev/full")
    assert code == 1
    assert "/dev/full is a device: an answer log is a regular file" in errors


def test_a_full_disk_is_said_and_what_was_kept_stays(
    table: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    taught("a\na\n", monkeypatch, capsys, table)
    before = told(Path("answers-care.jsonl"))

    def full(self: AnswerLog, *_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(AnswerLog, "append", full)
    code, _, errors = taught("a\n", monkeypatch, capsys, table)
    assert code == 1
    assert (
        "stopped: No space left on device. What was answered before is kept; to go on: "
        "qlearn" in errors
    )
    assert told(Path("answers-care.jsonl")) == before


def test_a_missing_extra_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("qlearn.problems.icu_sepsis.find_spec", lambda name: None)
    code, _, errors = taught("", monkeypatch, capsys)
    assert code == 1
    assert (
        errors
        == "qlearn: the ICU-Sepsis tables are not installed: pip install 'elicit-qlearn[icu]'\n"
    )
    assert not [*tmp_path.iterdir()]


def test_icu_sepsis_is_asked_about_patients(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    code, shown, _ = taught("a\n", monkeypatch, capsys)
    assert code == 0
    assert shown.startswith("ICU-Sepsis\nThe patients are alike at the start.")
    first = r"Question 1 \(about 10 to \d\d more\)\n\nTwo groups of 10 patients: which would "
    assert re.search(first, shown)
    assert icu_sepsis().labels[0] in shown


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "",
            "the first line of {} must name a column of names and then at least two levels, worst "
            "first",
        ),
        ("name,died\na,1\n", "it is 'name,died'"),
        ("name,died,well\n", "{} names levels, but no alternative to choose from"),
        ("name,died,well\na,1,2\nb,1\n", "line 3 of {} has 2 cells, but the header has 3"),
        ("name,died,well\n\na,1,x\n", "line 3 of {}: 'x' is no number of at least 0"),
        ("name,died,well\na,-1,2\n", "line 2 of {}: '-1' is no number of at least 0"),
        (
            "name,died,well\na,1,2\nb,1,3\n",
            "line 3 of {} has the total 4, and the first alternative 3: give all the",
        ),
        ("name,died,well\na,0,0\n", "line 2 of {} has the total 0"),
        ("name,died,died\na,1,2\n", "the first line of {} names the level 'died' twice"),
        ('name,died,well\n"a,1,2\n', "{} is no CSV"),
    ],
)
def test_what_is_wrong_with_a_csv_is_said(
    text: str,
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("x.csv").write_text(text)
    code, _, errors = taught("", monkeypatch, capsys, "--problem", "x.csv")
    assert code == 1
    assert said.format("x.csv") in errors


def test_a_csv_of_a_spreadsheet_with_semicolons_and_decimal_commas_is_read(tmp_path: Path) -> None:
    (tmp_path / "x.csv").write_text("name;died;well\nhere, now;0,25;0,75\nthere;1;0\n")
    labels, names, vectors = read_alternatives(tmp_path / "x.csv")
    assert (labels, names) == (("died", "well"), ["here, now", "there"])
    assert vectors.tolist() == [[0.25, 0.75], [1.0, 0.0]]


def test_a_csv_with_a_byte_order_mark_is_read_and_one_that_is_not_there_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "x.csv").write_text("\ufeffname, died ,well\nø,0.25,0.75\n", encoding="utf-8")
    labels, names, vectors = read_alternatives(tmp_path / "x.csv")
    assert (labels, names, vectors.tolist()) == (("died", "well"), ["ø"], [[0.25, 0.75]])
    (tmp_path / "x.csv").write_bytes(b"name,a,b\n\xff,1,2\n")
    with pytest.raises(ValueError, match="not in UTF-8"):
        read_alternatives(tmp_path / "x.csv")
    monkeypatch.chdir(tmp_path)
    code, _, errors = taught("", monkeypatch, capsys, "--problem", "y.csv")
    assert code == 1
    assert "there is no file y.csv" in errors


def test_bad_options_end_in_2(capsys: pytest.CaptureFixture[str]) -> None:
    for options, said in (
        (
            "--problem nothing",
            "invalid choice: 'nothing' (choose from 'random', 'icu-sepsis', 'rover', 'hazards', ",
        ),
        ("--problem nowhere:f", "there is no module 'nowhere'"),
        ("--days 1", "'1' is not a whole number of at least 2"),
        ("--problem ward.py", "for a function of that file write ward:function"),
        ("--comparator box", "invalid choice: 'box'"),
    ):
        with pytest.raises(SystemExit) as end:
            main(["teach", *options.split()])
        assert end.value.code == 2
        assert said in capsys.readouterr().err


def test_help_imports_nothing_heavy() -> None:
    code = (
        "import sys\nfrom qlearn.cli.main import main\ntry:\n    main(['teach', '--help'])\nexcept "
        "SystemExit:\n"
        "    print('heavy:', sorted({'numpy', 'scipy', 'numba', 'cvxpy'} & set(sys.modules)))"
    )
    *shown, heavy = run(code)
    assert "[answers-PROBLEM.jsonl, here]" in " ".join(" ".join(shown).split())
    assert heavy == "heavy: []"


def test_a_family_is_taught_in_its_own_words_and_a_seed_draws_it(
    lets_answer: Callable[..., str], tmp_path: Path
) -> None:
    hidden = {"ruined": 0.0, "in training": 0.1, "in a steady post": 0.3, "famous": 1.0}
    more = ("--log", "log.jsonl", "--tolerance", scaled("0.05", "0.01"))
    shown = lets_answer(hidden, "--problem", "career", "--seed", "4", *more)
    mdp = FAMILIES["career"](4)
    header = AnswerLog.read(tmp_path / "log.jsonl").header
    assert (header["problem"], header["unit"], header["labels"]) == (
        mdp.fingerprint,
        "years",
        [*mdp.labels],
    )
    assert "A steady post or a venture" in shown
    assert "Two groups of 10 years" in shown
    said = " ".join(report(shown).split())
    assert re.search(r"in 100 of your ideal plan\. (In \d+ of .*\. )?How sure: With ", said)
    assert "That is as much as if " in said[said.index("How sure: ") :]


def test_two_people_in_one_folder_have_a_log_each(
    table: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    typed = "a\na\nq\n"
    for name in ("Ann", "Dr. Ben & co"):
        _, shown, _ = taught(typed, monkeypatch, capsys, table, "--who", name)
        assert "Going on" not in shown
        assert "--who" in shown
    for name, path in (("Ann", "Ann"), ("Dr. Ben & co", "Dr-Ben-co")):
        log = AnswerLog.read(f"answers-care-{path}.jsonl")
        assert (log.who, {entry.answer.who for entry in log}) == (name, {name})
    before = Path("answers-care-Ann.jsonl").read_bytes()
    options = ("--who", "Ben", "--log", "answers-care-Ann.jsonl")
    code, _, errors = taught(typed, monkeypatch, capsys, table, *options)
    assert code == 1
    assert "holds the answers of 'Ann', not of 'Ben'" in errors
    assert Path("answers-care-Ann.jsonl").read_bytes() == before


def test_a_terminal_asks_for_a_name_once_and_enter_passes_on(
    table: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("care.words.json").write_text("{}")
    monkeypatch.setattr(Typed, "isatty", lambda _: True)
    _, shown, _ = taught("Ann\na\na\nq\n", monkeypatch, capsys, table)
    assert shown.startswith("Your name or a pseudonym")
    assert AnswerLog.read("answers-care-Ann.jsonl").who == "Ann"
    _, shown, _ = taught(f"{'x' * 81}\n\na\na\nq\n", monkeypatch, capsys, table)
    assert "a name has 1 to 80 characters" in shown
    assert AnswerLog.read("answers-care.jsonl").who is None
    _, shown, _ = taught("a\na\nq\n", monkeypatch, capsys, table, "--log", "answers-care.jsonl")
    assert "Your name" not in shown
