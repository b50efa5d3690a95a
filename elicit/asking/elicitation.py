"""Decides comparisons for a learner, and chooses which ones to put to the tutor.

An ``Elicitation`` takes differences, and returns verdicts or says that the tutor must be asked. The
learner reports which verdicts it acted on. All that learners and other askers have in common is
here: the comparator, indifference, the question budget, audits, answers "cannot tell" and "about
equal", and the counts. No pair is asked twice.
"""

import sys
from collections import Counter
from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import replace
from typing import Any, ClassVar, Literal, TypeAlias, Unpack, cast

import numpy as np
from numpy.typing import NDArray

from elicit._support import jit
from elicit._support.hashing import key_of
from elicit._support.seeds import seed_of
from elicit._support.validation import require
from elicit.asking.answered_pairs import AnsweredPairs
from elicit.asking.elicitation_kernel import (
    BOUNDS,
    NO_FACT,
    PLACE,
    AskingState,
    Facts,
    PairDecision,
    decide_rows,
)
from elicit.asking.near_ties import NearTies
from elicit.asking.options import (
    AskingOptions,
    EarlierAnswers,
    check_options,
    checked_known,
    checked_values,
)
from elicit.asking.question import AnsweredQuery, Audit, Pair, Pending, Place
from elicit.asking.several_people import CannotTell, addressed, nobody_left, verdict_of_all
from elicit.comparators.baselines import AlwaysAsk
from elicit.decision.comparator_rule import LearnsInLoops, Rule, rule_of
from elicit.decision.verdicts import decide
from elicit.model.comparator import (
    Comparator,
    Decisions,
    Tier,
    Verdicts,
    bounds_of,
    learn,
    offers,
)
from elicit.model.comparator_parts import (
    KeepsAnswers,
    LearnsInSteps,
    best_guess,
    people_of,
    tie_of,
    wrong_of,
)
from elicit.model.difference import tail_sums
from elicit.model.difference_kernel import LEFT_OPEN
from elicit.model.needs import Needs
from elicit.model.pairs import first_of_each_pair, same_pairs
from elicit.model.query import (
    Answer,
    Answers,
    InconsistentAnswers,
    Query,
    Verdict,
    match,
    query_id,
    query_ids,
)
from elicit.model.scale import Floats
from elicit.tutors.answer_log import EXPECTED, Entry

Watcher = Callable[[Floats, Decisions], None]
OnConflict: TypeAlias = Literal["raise", "drop"]


class Elicitation:
    """Decides differences for one asker, such as a learner, and keeps the answers and the counts.

    Some pairs are certainly near: their values differ by no more than about the comparator's
    ``tie``, so the tutor may call them equal, and such an answer teaches next to nothing. Once the
    tutor has called the last few of these equal, no more of them are asked, and they count as
    equal.

    If the comparator is of several people, it says whom to ask. A pair then stays open, and others
    are asked about it, until the comparator can decide or no further answer would help.

    Parameters
    ----------
    comparator : Comparator
    fingerprint : str
        Names the problem in the ids of queries.
    undecided : Verdict
        The verdict on a question's left vector if the tutor cannot tell.
    **asking
        The options of ``AskingOptions``. An indifference of None is 0.

    Raises
    ------
    TypeError
        If an option is unknown.
    ValueError
        If an option is out of range.
    InconsistentAnswers
        If ``known`` contradicts itself, or what the comparator knows.
    """

    needs: ClassVar[Needs] = Needs(
        used=("rule", "decide_rest", "tie", "wrong", "answers", "people", "whom")
    )

    def __init__(
        self,
        comparator: Comparator,
        fingerprint: str,
        *,
        undecided: Verdict = Verdict.EQUAL,
        **asking: Unpack[AskingOptions],
    ) -> None:
        check_options(self, asking)
        options = checked_values(asking, comparator.k)
        self._several = len(people_of(comparator)) > 1
        require(
            not (options.audit and self._several),
            "audit, of a comparator of several people,",
            "0: an audit asks one person what the answers of all imply",
            asking.get("audit"),
        )
        self.comparator = comparator
        self.batch = options.batch
        self.answers = Answers.none(comparator.k)
        self.asked = 0
        self.cannot_tell = 0
        self.audits: list[Audit] = []
        self.counts = np.zeros(len(Tier), dtype=np.int64)
        self.watch: Watcher | None = None
        self.signs: Callable[[Floats], NDArray[np.int8]] | None = None
        self.pending: tuple[Pending, ...] = ()
        # the last answers: a learner empties it after acting, so that an interruption loses none
        self.to_act_on: tuple[AnsweredQuery, ...] = ()
        self.puts_off = (
            False  # whether undecided pairs go by the best guess for now, to be asked about later
        )
        self._fingerprint = fingerprint
        self._indifference, self._max_queries = options.indifference, options.max_queries
        self._audit, self._max_audits = options.audit, options.max_audits
        tie = 0.0 if isinstance(comparator, AlwaysAsk) else tie_of(comparator)
        self._near_ties = NearTies(tie, counts=tie > 0 and not self._several)
        self._key = np.uint64(key_of(seed_of(asking.get("seed", 0))))
        self._number = 0
        self._answered = AnsweredPairs(comparator.k)
        self._undecided = undecided
        self._labels = options.labels
        self._cannot = CannotTell()
        self._unclear: set[Hashable] = set()  # names of where the tutor could not tell
        self._untold = False  # whether there are pairs known as such that the tutor could not tell
        self._guess: tuple[Comparator, Floats] | None = None
        self._learn_known(asking.get("known", ()))

    def decide(self, d: Floats, places: Callable[[int], Place] | None = None) -> Decisions:
        """Decide differences d (n, k) by the comparator, earlier answers and the question budget.

        The verdict is UNKNOWN if the tutor must be asked. Its tier is then TUTOR, or in an audit
        the tier that had decided the pair. Nothing is counted: see ``commit``.

        ``places`` gives each row's place. If the tutor could not tell a pair, the learner's
        estimates at its place keep changing a little. The place says that a new version is still
        the same pair, so that a person is not asked about it again.
        """
        n, t = len(d), np.ascontiguousarray(tail_sums(d))
        verdicts, tiers = decide(self.comparator, d)
        unclear, close = np.full((2, n), LEFT_OPEN)
        facts = Facts(verdicts.astype(np.int64), tiers.astype(np.int64), unclear, close)
        verdict, tier, needed = np.empty((3, n), np.int8)
        out = PairDecision(verdict, tier, np.empty(0, np.bool_), needed)
        asking, rows = self.asking_state(), np.arange(n)
        jit.expect(decide_rows, 1e-5 * n)
        while len(rows):
            with np.errstate(all="ignore"):  # hashes wrap around
                decide_rows(rows, t, asking, facts, out)
            rows = rows[out.needed[rows] != NO_FACT]
            of = [rows[out.needed[rows] == fact] for fact in (PLACE, BOUNDS)]
            unclear[of[0]] = [
                places is not None and self._is_unclear(places(int(row))) for row in of[0]
            ]
            if len(of[1]):
                low, high = bounds_of(self.comparator, d[of[1]])
                near = (low >= -self.indifference) & (high <= self.indifference)
                close[of[1]] = np.where(near, Verdict.EQUAL, Verdict.UNKNOWN)
        if self.signs is not None:
            asked = np.flatnonzero((verdict == Verdict.UNKNOWN) & (tier == Tier.TUTOR))
            verdict[asked] = self.signs(d[asked]) if len(asked) else 0
        return Decisions(verdict, tier)

    def asking_state(self) -> AskingState:
        """Return all that ``decide`` depends on, except the comparator, as plain arrays."""
        asks = self.signs is None
        return AskingState(
            indifference=self.indifference if asks else 0.0,
            audit=self._audit if self.audits_left else 0.0,
            key=self._key,
            answered=self._answered.table,
            plain=not (self._audit or self._answered.any_binding),
            unclear=bool(self._unclear),
            guess=self._gaps() if asks and self.guesses else np.empty(0),
        )

    def commit(self, d: Floats, decisions: Decisions) -> None:
        """Count verdicts that the learner acted on."""
        if not len(d):
            return
        self.counts += np.bincount(decisions.tiers, minlength=len(Tier))
        if self.signs is not None:
            self.asked = int(self.counts[Tier.TUTOR])
        if self.watch is not None:
            self.watch(d, decisions)

    def open(self, pairs: Sequence[Pair]) -> tuple[Query, ...]:
        """Make a query of each pair, and return the queries, which are now the pending ones.

        The verdicts on the pairs are UNKNOWN.
        """
        pending, number = [], self._number
        for pair in pairs:
            query = self._query(pair, number)
            number += 1
            expected = None if pair.tier == Tier.TUTOR else _implied(self.comparator, query.d)
            pending.append(Pending(query, pair, expected))
        self._publish(pending=tuple(pending), _number=number)
        return self.ask()

    def ask(self) -> tuple[Query, ...]:
        """Return the pending queries."""
        return tuple(p.query for p in self.pending)

    def tell(
        self, answers: Sequence[Answer], on_conflict: OnConflict
    ) -> tuple[dict[str, Verdict], tuple[Answer, ...]]:
        """Take answers to pending queries; return verdicts by query id, and the dropped answers.

        If the tutor cannot tell, the verdict is ``undecided``; in an audit it is the one that the
        answers imply. Answers that contradict earlier ones are dropped with ``on_conflict="drop"``.
        If it raises, nothing has changed. If Ctrl+C interrupts it, either nothing has changed or
        everything has. In the second case the verdicts are in ``to_act_on``.
        """
        if on_conflict not in ("raise", "drop"):
            raise ValueError(f"on_conflict must be 'raise' or 'drop', not {on_conflict!r}")
        waiting = {p.query.id: p for p in self.pending}
        answers = match(answers, self.ask())
        if self._several:  # an answer to a copy of the query, from a log say, may not name anybody
            asked_of = {name: p.query.who for name, p in waiting.items()}
            answers = tuple(
                answer if answer.who else replace(answer, who=asked_of[answer.query.id])
                for answer in answers
            )
        told = [answer for answer in answers if answer.verdict is not None]
        rows = Answers.of(told, self.comparator.k)
        comparator, taken = learn(self.comparator, rows, on_conflict == "drop")
        near_ties = self._near_ties.after_all(self.comparator, answers)
        if not taken.all():
            rows = Answers.of(
                [answer for answer, took in zip(told, taken, strict=True) if took],
                self.comparator.k,
            )
        dropped = tuple(answer for answer, took in zip(told, taken, strict=True) if not took)
        paired = [
            (answer, waiting[answer.query.id], any(answer is other for other in dropped))
            for answer in answers
        ]
        cannot = self._cannot_now(paired)
        verdicts = [
            verdict_of_all(comparator, asked.pair, cannot, self.indifference)
            if self._several
            else self._act_on(answer, asked, unused, comparator)
            for answer, asked, unused in paired
        ]
        # an interruption may come at any line: so copies are changed, and published all at once
        answered, unclear, audits = self._answered.copy(), set(self._unclear), list(self.audits)
        counts, asked_so_far, cannot_tell = self.counts.copy(), self.asked, self.cannot_tell
        seen = []
        for (answer, (query, pair, expected), unused), verdict in zip(
            paired, verdicts, strict=True
        ):
            del waiting[query.id]
            cannot_tell += answer.verdict is None
            if verdict == Verdict.UNKNOWN:  # the next of several is to be asked
                asked_so_far += 1
                continue
            if expected is None:
                asked_so_far += 1
                if answer.verdict is None and not self._several:
                    unclear.update(pair.place)
            else:
                audits.append(Audit(query, expected, answer.verdict))
            said = verdict if answer.verdict is None else answer.verdict
            if self._several:
                if nobody_left(comparator, pair, cannot):
                    answered.add(pair.left - pair.right, verdict, binding=verdict == Verdict.EQUAL)
            elif (
                unused
                or answer.verdict is None
                or self._enough_agree(self.answers + rows, query.d, said)
            ):
                answered.add(query.d, said, binding=unused or said == Verdict.EQUAL)
            overruled = expected is not None and verdict != expected  # by the audit's answer
            tier = int(Tier.KNOWN) if overruled else pair.tier
            counts[tier] += 1
            d = pair.left - pair.right if self._several else query.d
            seen.append((d, Decisions(np.array([verdict], np.int8), np.array([tier], np.int8))))
        self._publish(
            comparator=comparator,
            answers=self.answers + rows,
            audits=audits,
            asked=asked_so_far,
            cannot_tell=cannot_tell,
            counts=counts,
            pending=tuple(waiting.values()),
            to_act_on=tuple(
                AnsweredQuery(asked, verdict)
                for (_, asked, _), verdict in zip(paired, verdicts, strict=True)
                if verdict != Verdict.UNKNOWN
            ),
            _answered=answered,
            _cannot=cannot,
            _near_ties=near_ties,
            _unclear=unclear,
        )
        if self.watch is not None:  # last, for it may fail
            for d, decisions in seen:
                self.watch(d[None, :], decisions)
        return {
            answer.query.id: verdict for answer, verdict in zip(answers, verdicts, strict=True)
        }, dropped

    def _publish(self, **state: Any) -> None:
        """Set several attributes at once, so that Ctrl+C cannot come between them."""
        vars(self).update(state)

    @property
    def room(self) -> int:
        """The number of answers that a compiled loop may take before it returns to Python.

        It is 0 if each answer may change what is asked next.
        """
        comparator = self.comparator
        if self._near_ties.tie or not hasattr(type(comparator), "answers_to_next_step"):
            return 0
        return self._at_most(cast(LearnsInSteps, comparator).answers_to_next_step)

    @property
    def room_in_rule(self) -> int:
        """The number of answers "better" or "worse" that a compiled loop may add to the rule.

        The rule is the comparator's knowledge as arrays.
        """
        comparator = self.comparator
        near_matter = self._near_ties.in_a_row or self.indifference
        if near_matter or not isinstance(comparator, LearnsInLoops):
            return 0
        return self._at_most(sys.maxsize) if rule_of(comparator).grows else 0

    def _at_most(self, room: int) -> int:
        """Return ``room``, or the number of questions left in the budget if that is less.

        The result is 0 if Python must see each answer.
        """
        unfree = self._audit or self._unclear or self.pending or self.guesses or self.signs
        if unfree or self._several:
            return 0
        return room if self._max_queries is None else min(room, self._max_queries - self.asked)

    def take(
        self, left: Floats, right: Floats, verdicts: Verdicts, rule: Rule | None = None
    ) -> None:
        """Learn answers (n,) that a compiled loop got from a simulated tutor.

        The answers are about vectors left and right (n, k), at most ``room`` of them. They count as
        if they had been asked and told one by one. The loop itself counts the comparisons. If it
        has added the answers to the comparator's arrays (see ``room_in_rule``), these are given as
        ``rule``.
        """
        first = self._number
        told = Answers(left - right, verdicts, query_ids(self._fingerprint, first, left, right))
        comparator = (
            self.comparator.update(told)
            if rule is None
            else cast(LearnsInLoops, self.comparator).learned_in_loop(told, rule)
        )
        self._answered.add_many(
            told.d, verdicts
        )  # twice does no harm, should the rest be interrupted
        number, asked = first + len(told), self.asked + len(told)
        self._publish(
            comparator=comparator, answers=self.answers + told, _number=number, asked=asked
        )

    def take_at_once(self, left: Floats, right: Floats, verdict: Verdict) -> bool:
        """Learn an answer about vectors left and right (k,) without a query; return success.

        The effect is that of ``open`` and ``tell``, but no Query and no Answer are made: only a
        person or a log needs them. If the result is False, nothing has changed, and ``open`` and
        ``tell`` are needed. That is so if the answer is "equal" or contradicts others, if the last
        answer to a pair that is certainly near was "equal", if queries are pending, if pairs are
        decided by guesses, and if the comparator is of several people.
        """
        if verdict == Verdict.EQUAL or self._near_ties.in_a_row or self.pending or self.guesses:
            return False
        if self._several:  # who, only ``open`` says
            return False
        name = query_id(self._fingerprint, self._number, left, right)
        told = Answers((left - right)[None, :], [int(verdict)], [name])
        try:
            comparator, _ = learn(self.comparator, told, one_by_one=False)
        except InconsistentAnswers:
            return False
        answered, counts = self._answered.copy(), self.counts.copy()
        answered.add(told.d[0], verdict, binding=False)
        counts[Tier.TUTOR] += 1
        self._publish(
            comparator=comparator,
            answers=self.answers + told,
            asked=self.asked + 1,
            counts=counts,
            _answered=answered,
            _number=self._number + 1,
        )
        if self.watch is not None:  # last, for it may fail
            tiers = np.array([Tier.TUTOR], np.int8)
            self.watch(told.d, Decisions(told.y.copy(), tiers))
        return True

    @property
    def audits_left(self) -> int:
        """The number of audits that may still be made."""
        return max(0, self._max_audits - len(self.audits))

    @property
    def indifference(self) -> float:
        """The greatest bounds on d.e with which an undecided pair counts as equal.

        It is the option's value, and more once the tutor has called near pairs equal.
        """
        if self.gave_up:
            return max(self._indifference, self._near_ties.near)
        return self._indifference

    @property
    def gave_up(self) -> bool:
        """True if pairs that are certainly near count as equal without being asked.

        That is so once the tutor has called the last few of them equal.
        """
        return self._near_ties.gave_up

    @property
    def called_equal(self) -> bool:
        """True if some pairs count as equal although they may differ by more than the indifference.

        The tutor has called these pairs equal, or others that are as near.
        """
        wider = self._near_ties.tie > self._indifference
        return wider and bool((self.answers.y == 0).any() or self.gave_up)

    @property
    def max_queries(self) -> int | None:
        """The largest number of questions; None if there is no limit."""
        return self._max_queries

    @property
    def spent(self) -> bool:
        """True if the question budget is used up."""
        return self._max_queries is not None and self.asked >= self._max_queries

    @property
    def unsure(self) -> bool:
        """True if some pairs count as ties because the tutor could not tell.

        Audits that the tutor could not tell do not matter: their pairs keep the verdict of the
        answers.
        """
        return bool(self._unclear) or self._untold

    @property
    def guesses(self) -> bool:
        """True if undecided pairs are decided by the best guess at the scale, and not asked about.

        That is so if the budget is spent, or if the learner puts questions off.
        """
        return self.puts_off or self.spent

    def may_ask(self, d: Floats, places: Callable[[int], Place]) -> NDArray[np.bool_]:
        """Return flags (n,): which of the differences d (n, k) may be put to the tutor.

        Two kinds may not: those already answered, and those at a place at which the tutor could not
        tell. ``places`` gives the place of a row.
        """
        new: NDArray[np.bool_] = self._answered.said(tail_sums(d)) == Verdict.UNKNOWN
        if self._unclear:
            new &= ~np.array([self._is_unclear(places(i)) for i in range(len(d))], dtype=np.bool_)
        return new

    def unable(self, pair: Pair) -> tuple[str, ...]:
        """Return who, of several people, could not tell a pair or contradicted themselves on it."""
        return self._cannot.names(pair)

    def _is_unclear(self, place: Place) -> bool:
        return not self._unclear.isdisjoint(place)

    def next_batch(self, d: Floats) -> list[int]:
        """Return the rows of differences d (n, k), all UNKNOWN, to ask about now.

        They are the first rows of different pairs, as many as ``batch`` and the budget allow.
        """
        room = (
            self.batch
            if self._max_queries is None
            else max(1, min(self.batch, self._max_queries - self.asked))
        )
        return first_of_each_pair(d, room)

    def _learn_known(self, known: EarlierAnswers) -> None:
        """Take in earlier answers, given as the option ``known``."""
        k = self.comparator.k
        known = checked_known(known, k)
        if isinstance(known, Answers):
            told = known
            self._keep(told)
        else:
            told = Answers.of(
                [answer for answer in map(self._enter, known) if answer is not None], k
            )
            if wrong_of(self.comparator):
                self._keep(told)
        own = (
            cast(KeepsAnswers, self.comparator).answers
            if offers(self.comparator, "answers")
            else None
        )
        had = Counter(() if own is None else _rows(own, self._several))
        new = []
        for i, row in enumerate(_rows(told, self._several)):
            had[row] -= 1
            if had[row] < 0:
                new.append(i)
        if new:
            try:
                self._learn_in_order(told.take(new))
            except InconsistentAnswers as error:
                error.add_note(
                    "They are among what was known: leave one out of known=, of a log by "
                    "log.retract(id)"
                )
                raise
        self.answers = told

    def _learn_in_order(self, told: Answers) -> None:
        """Have the comparator learn these answers, as if they had been told one by one.

        Answers "equal" to certainly near pairs are counted.
        """
        done = 0
        for i, y in enumerate(told.y if self._near_ties.counts else ()):
            if y == 0 or self._near_ties.in_a_row:
                self.comparator, _ = learn(self.comparator, told[done:i], one_by_one=False)
                done = i
                self._near_ties = self._near_ties.after(self.comparator, told.d[i], bool(y == 0))
        self.comparator, _ = learn(self.comparator, told[done:], one_by_one=False)

    def _enter(self, entry: Entry) -> Answer | None:
        """Note an earlier answer in the counts, and return it if the comparator is to learn it."""
        answer = entry.answer
        if entry.retracted:
            return None
        if EXPECTED in entry.metadata:
            self.audits.append(
                Audit(answer.query, Verdict(entry.metadata[EXPECTED]), answer.verdict)
            )
        if entry.repeat:  # the first answer stands
            return None
        said = self._undecided if answer.verdict is None else answer.verdict
        taken = entry.used and answer.verdict is not None
        if self._several:
            if not taken:
                self._cannot = self._cannot.adding(answer.who, answer.query.d)
            return answer if taken else None
        if answer.verdict is None:
            self._untold = True
            self._unclear.update({answer.query.about} - {""})
        if not (
            taken and wrong_of(self.comparator)
        ):  # else it takes all answers to see which are enough
            self._answered.add(
                answer.query.d, said, binding=not entry.used or said == Verdict.EQUAL
            )
        return answer if taken else None

    def _keep(self, told: Answers) -> None:
        """Note answers as final for their pairs, where enough answers agree."""
        if self._several:  # one person cannot say what the others would
            return
        for i, y in enumerate(told.y.tolist()):
            if self._enough_agree(told[: i + 1], told.d[i], y):
                self._answered.add(told.d[i], y, binding=y == 0)

    def _enough_agree(self, answers: Answers, d: Floats, verdict: int) -> bool:
        """Return whether enough answers give this verdict on d (k,) not to ask it again.

        One is enough if every answer is right. For each answer that may be wrong, one more is
        needed.
        """
        wrong = wrong_of(self.comparator)
        if not wrong:
            return True
        ways = same_pairs(tail_sums(d), tail_sums(answers.d))
        return int(((ways != 0) & (ways * answers.y == verdict)).sum()) > wrong

    def _act_on(
        self, answer: Answer, asked: Pending, unused: bool, comparator: Comparator
    ) -> Verdict:
        """Return the verdict to act on after an answer.

        It is the tutor's verdict, or ``undecided`` if the tutor cannot tell. In an audit, an answer
        that fits the others has been learned, and the comparator's verdict counts if it has one.
        """
        if answer.verdict is None:
            return self._undecided if asked.expected is None else asked.expected
        if asked.expected is None or unused or answer.verdict is Verdict.EQUAL:
            return answer.verdict
        now = _implied(comparator, asked.query.d)
        return answer.verdict if now is Verdict.UNKNOWN else now

    def _query(self, pair: Pair, number: int) -> Query:
        """Return the question about a pair, addressed to the person whom the comparator chooses."""
        asked = addressed(self.comparator, pair, self._cannot)
        return Query.make(
            self._fingerprint, number, asked.left, asked.right, asked.about, self._labels, asked.who
        )

    def _cannot_now(self, paired: Sequence[tuple[Answer, Pending, bool]]) -> CannotTell:
        """Return the pairs that each of several people cannot tell, after these answers.

        A dropped answer counts as "cannot tell": asking the same person again would not help.
        """
        cannot = self._cannot
        for answer, asked, unused in paired if self._several else ():
            if unused or answer.verdict is None:
                cannot = cannot.adding(answer.who, asked.pair.left - asked.pair.right)
        return cannot

    def _gaps(self) -> Floats:
        if self._guess is None or self._guess[0] is not self.comparator:
            self._guess = (self.comparator, np.diff(best_guess(self.comparator)))
        return self._guess[1]


def _rows(answers: Answers, several: bool) -> Iterator[tuple[bytes, int, str | None]]:
    """Return for each answer its difference, its verdict, and its person if there are several."""
    who = answers.who if several else (None,) * len(answers)
    return zip(map(np.ndarray.tobytes, answers.d), answers.y.tolist(), who, strict=True)


def _implied(comparator: Comparator, d: Floats) -> Verdict:
    """Return a comparator's verdict on one difference d (k,)."""
    return Verdict(int(decide(comparator, d).verdicts[0]))
