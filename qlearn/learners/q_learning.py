"""Interactive Q-learning (the paper's Algorithm 1) with any comparator, as ask and tell."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias, Unpack

import numpy as np
from numpy.typing import NDArray

from elicit._support import jit
from elicit._support.hashing import fold, key_of, uniform
from elicit._support.seeds import seed_of, takes_rng
from elicit._support.validation import is_whole, require
from elicit.asking.elicitation import Elicitation
from elicit.asking.options import AskingOptions, check_options, filled
from elicit.asking.question import AnsweredQuery, Pair
from elicit.decision.comparator_rule import rule_of
from elicit.model.comparator import Comparator, Decisions, Tier
from elicit.model.needs import Needs, check_needs
from elicit.model.outcomes import Status
from elicit.model.query import Query, Verdict
from elicit.model.scale import Floats
from qlearn.learners.exploration import (
    Epsilon,
    Exploration,
    Start,
    epsilons,
    exploration_of,
    schedule,
)
from qlearn.learners.learner import Learner, Result, check_problem, pair_of
from qlearn.learners.loops import q_learning_kernel as kernel
from qlearn.learners.loops.action_pair_kernel import AnswersInLoops, PairDecider
from qlearn.mdp.ordinal_mdp import OrdinalMDP

LearningRate: TypeAlias = float | Callable[[NDArray[np.int64]], Floats]


def rescaled_linear_rate(discount: float) -> Callable[[NDArray[np.int64]], Floats]:
    """Return the default learning rate (H + 1) / (H + 1 + visits), as a function of visits.

    ``visits`` is the number of earlier visits, and H = 1 / (1 - discount) the effective horizon
    (Jin, Allen-Zhu, Bubeck and Jordan 2018). The rate falls slowly enough to forget the start.
    """
    horizon = 1.0 / (1.0 - discount)
    return lambda visits: np.asarray((horizon + 1.0) / (horizon + 1.0 + visits), dtype=np.float64)


def polynomial_rate(visits: NDArray[np.int64]) -> Floats:
    """Return the learning rate 1 / (1 + earlier visits)^0.7 (Even-Dar and Mansour 2003)."""
    return np.asarray((1.0 + visits) ** -0.7, dtype=np.float64)


# The loop returns to Python after this many steps, and then whenever their number has grown by this
# factor. So an interpreted loop that turns out to be slow is compiled, and Ctrl+C works.
_FIRST_PIECE, _GROWTH = 256, 8


class InteractiveQLearning(Learner):
    """Epsilon-greedy Q-learning on share vectors, the paper's Algorithm 1.

    It asks the tutor about each pair of actions that the comparator cannot decide. Learning samples
    the MDP's transitions. Only ``Result.loss_bound`` reads their probabilities.

    Parameters
    ----------
    mdp : OrdinalMDP
    comparator : Comparator
        What is known of the scale so far. Its number of levels must be the MDP's.
    steps : int
        Number of transitions to learn from.
    epsilon : float, Decay, function, Exploration or str, optional
        The way to explore. A number, a ``Decay`` or a function from steps to numbers is the
        probability of an action drawn uniformly. An ``Exploration``, or the name of one of
        ``EXPLORATIONS``, also says where vectors start and when episodes end. Default:
        "optimistic", chosen by measurement (docs/exploration.md).
    learning_rate : float or function, optional
        A constant in (0, 1], or a function from the number of earlier visits of (s, a) to rates.
        Default: ``rescaled_linear_rate(mdp.discount)``.
    **asking
        The options of ``elicit.AskingOptions``. Exploration, transitions and audits depend on the
        seed (``rng`` is another word for it). The default of ``indifference`` is 0. ``batch`` has
        no effect: a run of Q-learning has one pair in question at a time.

    Attributes
    ----------
    model : Model
        The arrays that the compiled loop reads.
    state : State
        The arrays that it changes.

    Raises
    ------
    TypeError
        If a keyword is unknown.
    ValueError
        If a setting is out of range.
    """

    needs = Learner.needs | Needs(used=("answers_to_next_step", "learned_in_loop"))

    @takes_rng
    def __init__(
        self,
        mdp: OrdinalMDP,
        comparator: Comparator,
        *,
        steps: int = 100_000,
        epsilon: Epsilon | Exploration | str | None = None,
        learning_rate: LearningRate | None = None,
        **asking: Unpack[AskingOptions],
    ) -> None:
        check_options(self, asking)
        check_problem(mdp, comparator)
        check_needs(comparator, type(self))
        self.seed = seed_of(asking.get("seed", 0))
        exploration = exploration_of(epsilon)
        require(is_whole(steps, 0), "steps", "a whole number of at least 0", steps)
        key = key_of(self.seed)
        self._mdp = mdp
        asking["seed"] = int(fold(key, kernel.AUDITS))
        self._elicitation = Elicitation(
            comparator,
            f"{mdp.fingerprint}/q-learning/{key}",
            **filled(asking, {"labels": mdp.labels}),
        )
        rate = rescaled_linear_rate(mdp.discount) if learning_rate is None else learning_rate
        wanted = (
            "learning_rate must be a number in (0, 1], or a function from visits (n,) to such "
            "rates (n,)"
        )
        self.model = kernel.Model(
            successors=mdp.successors.astype(np.int64),
            cumulative=np.cumsum(mdp.probabilities, axis=2),
            levels=mdp.levels.astype(np.int64),
            actions=np.argsort(~mdp.admissible, axis=1, kind="stable"),
            n_actions=mdp.admissible.sum(axis=1),
            terminal=mdp.terminal.view(),
            initial=np.cumsum(mdp.initial),
            rates=np.resize(schedule(rate, steps, wanted, positive=True), max(1, steps)),
            discount=mdp.discount,
            epsilons=epsilons(exploration.epsilon, steps),
            steps=int(steps),
            episode_length=int(exploration.episode_length or 0),
            key=np.uint64(key),
        )
        for array in self.model:
            if isinstance(array, np.ndarray):
                array.flags.writeable = False  # copies of the learner share them
        jit.expect(kernel.advance, 1e-3 * steps)
        self.state = _first_state(mdp, self.model, exploration.start)
        self._pairs = PairDecider(self._elicitation, mdp.n_states * mdp.n_actions)
        self._verdict = int(Verdict.UNKNOWN)  # on the pair at the cursor

    def result(self) -> Result:
        """Return the greedy policy and the counts so far."""
        rounds = int(self.state.cursor[kernel.STEP])
        return self._result(
            self._mdp, self.state.best.copy(), self.state.q.copy(), self._status(), rounds
        )

    def run_to(self, steps: int, puts_off: bool = False) -> tuple[Query, ...]:
        """Run to a step, or to a pair that only the tutor can decide.

        Parameters
        ----------
        steps : int
            The number of steps, counted from the start of the run.
        puts_off : bool
            If it is True, such pairs are decided by the best guess at the scale instead. Default:
            False.

        Returns
        -------
        tuple of Query
            The query about the pair; () if the step was reached.
        """
        elicitation, state = self._elicitation, self.state
        elicitation.puts_off = puts_off
        self._pairs.take_told()
        rule = rule_of(elicitation.comparator)
        while True:
            deciding, verdict = self._pairs.arrays(rule), self._verdict
            step = int(state.cursor[kernel.STEP])
            end = min(steps, max(_GROWTH * step, _FIRST_PIECE))
            with np.errstate(all="ignore"):  # the hash wraps around
                code, known = kernel.advance_and_ask(
                    state, self.model._replace(steps=end), verdict, deciding
                )
            self._verdict = int(Verdict.UNKNOWN)  # used up, in case the rest is interrupted
            decided = state.decided.copy()
            state.decided[:] = 0
            if self._pairs.enter(decided, rule._replace(known=known)):
                rule = rule_of(elicitation.comparator)
            if code == kernel.DONE and end == steps:
                return ()
            if code in (kernel.DONE, kernel.FULL):
                continue
            if code == kernel.ASK and elicitation.signs is None:
                said = self._pairs.answer(*self._vectors())
                if said is None:
                    return elicitation.open([self._pair()])
                self._verdict, rule = int(said), rule_of(elicitation.comparator)
                continue
            pair = self._pair()
            d = (pair.left - pair.right)[None, :]
            places = [pair.place]  # of the only row
            verdicts, tiers = elicitation.decide(d, places.__getitem__)
            if verdicts[0] == Verdict.UNKNOWN:
                return elicitation.open([pair._replace(tier=int(tiers[0]))])
            self._verdict = int(verdicts[0])
            elicitation.commit(d, Decisions(verdicts, tiers))

    def ask_within(self, tutor: AnswersInLoops | None) -> None:
        """Let the compiled loop ask a tutor directly from now on.

        It does so only if the results are the same: with a comparator that is ``LearnsInSteps``, no
        audits and no ties.

        Parameters
        ----------
        tutor : simulated tutor or None
            A tutor of ``elicit`` that is also available as plain arrays (``respondent``). None: the
            loop no longer asks.
        """
        self._pairs.tutor = tutor

    @property
    def done(self) -> bool:
        """True if all steps were taken."""
        return bool(self.state.cursor[kernel.STEP] >= self.model.steps)

    def _go_on(self) -> tuple[Query, ...]:
        return self.run_to(self.model.steps)

    def _take(self, told: Sequence[AnsweredQuery]) -> None:
        """Pass the tutor's verdict to the loop, if it is about the pair at the loop's cursor."""
        if self.state.cursor[kernel.POSITION] != kernel.IDLE:  # else it was asked between two steps
            for _, verdict in told:
                self._verdict = int(verdict)
        self._pairs.take_answers()

    def _status(self) -> Status:
        if self._elicitation.pending or not self.done:
            return Status.WAITING
        if self._elicitation.counts[Tier.GUESS]:
            return Status.GUESSED
        return Status.CALLED_EQUAL if self._elicitation.gave_up else Status.DONE

    def _pair(self) -> Pair:
        """Return the question about the two actions at the loop's cursor."""
        return pair_of(self._mdp, *self._vectors(), *self._place())

    def _place(self) -> tuple[int, int, int]:
        """Return the state at the loop's cursor, the challenging action, and the best so far."""
        s, position = self.state.cursor[[kernel.STATE, kernel.POSITION]].tolist()
        return s, int(self.model.actions[s, position]), int(self.state.best[s])

    def _vectors(self) -> tuple[Floats, Floats]:
        """Return copies of the vectors (k,) of the challenger and of the best action so far."""
        s, challenger, incumbent = self._place()
        return self.state.q[s, challenger].copy(), self.state.q[s, incumbent].copy()


def _first_state(mdp: OrdinalMDP, model: kernel.Model, start: Start) -> kernel.State:
    n, m, k = mdp.n_states, mdp.n_actions, mdp.k
    q = np.zeros((n, m, k))
    if start != "zero":
        q[:, :, 0 if start == "worst" else k - 1] = 1.0  # Alg. 1, l. 4
    q[mdp.terminal] = np.eye(k)[
        mdp.final_level[mdp.terminal], None
    ]  # a terminal state's value is its level, for ever
    pick = (uniform(fold(model.key, kernel.FIRST_BEST, np.arange(n))) * model.n_actions).astype(
        np.int64
    )
    best = model.actions[np.arange(n), pick]  # Alg. 1, l. 5
    cursor = np.zeros(7, dtype=np.int64)
    cursor[kernel.POSITION] = kernel.IDLE
    cursor[kernel.STATE] = kernel.draw(
        model.initial, float(uniform(fold(model.key, kernel.RESTART, 0)))
    )
    decided = np.zeros(len(Tier), np.int64)
    return kernel.State(
        q=q, best=best, visits=np.zeros((n, m), np.int64), cursor=cursor, decided=decided
    )
