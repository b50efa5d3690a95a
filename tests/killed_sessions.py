"""Sessions killed at random moments while a scripted person answers. Run as a program, which forks
a process for each try, so that nothing needs to be imported again: FOLDER KILLS SEED SIZE."""

import itertools
import json
import os
import random
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from elicit import AnswerLog, FlippingTutor, PolytopeComparator, Query, Session, Verdict, choose
from qlearn import InteractiveValueIteration, random_mdp

Make = Callable[[Any], Any]
Person = Callable[[Query], Verdict | None]


def person(values: Any, rate: float) -> Person:
    """One who errs, and whose answer depends on the question alone."""
    return lambda query: FlippingTutor(values, rate, seed=2)(query).verdict


def order_of(result: Any) -> list[int]:
    return list(result.order)


def policy_of(result: Any) -> list[int]:
    found: list[int] = result.policy.tolist()
    return found


def cases(small: bool) -> list[tuple[Make, Person, Callable[[Any], list[int]]]]:
    """A choice, and a learner whose audits find contradictions; who answers; and what comes out."""
    vectors = np.random.default_rng(0).dirichlet(np.ones(5), 6 if small else 16)
    k = 5 if small else 8
    mdp, values = random_mdp(6 if small else 15, 3, k, discount=0.9, rng=3)
    scale = [0.0, 10.0, 11.0, 40.0, 99.0]

    def choosing(known: Any) -> Any:
        return choose(vectors, PolytopeComparator(5), order=True, known=known)

    def learning(known: Any) -> Any:
        more = {"tolerance": 0.05, "audit": 0.3, "max_audits": 8, "rng": 1}
        return InteractiveValueIteration(mdp, PolytopeComparator(k), known=known, **more)

    return [(choosing, person(scale, 0.1), order_of), (learning, person(values, 0.15), policy_of)]


def answer_all(make: Make, says: Person, log: Path, acknowledged: Path) -> Any:
    """The session to its end; what is acknowledged is written down. Returns its result."""
    with Session(make, log) as session, open(acknowledged, "ab", buffering=0) as said:
        while query := session.question():
            session.answer(query.id, says(query))
            said.write(f"{query.id}\n".encode())
        return session.result()


def told(log: Path) -> list[Any]:
    """The answers of a log."""
    return [[e.answer.query.id, e.answer.verdict, e.used, e.retracted] for e in AnswerLog.read(log)]


def killed(folder: Path, kills: int, seed: int, small: bool) -> dict[str, Any]:
    """Run a session that is killed so many times, and count.

    The result has the numbers of kills, of answers and of those marked unused, and the faults that
    were found. There should be none.
    """
    chance, wrong, done, answers, unused, round_ = random.Random(seed), [], 0, 0, 0, 0
    undisturbed = []
    for case, (make, says, outcome) in enumerate(cases(small)):
        for name in ("cold", "undisturbed"):  # the first one compiles
            start = time.monotonic()
            result = answer_all(
                make, says, folder / f"{name}-{case}", folder / f"{name}-{case}.said"
            )
        undisturbed.append(
            (told(folder / f"undisturbed-{case}"), outcome(result), time.monotonic() - start)
        )
    while done < kills or round_ < 2:
        case = round_ % 2
        make, says, outcome = cases(small)[case]
        expected, best, seconds = undisturbed[case]
        log, said = folder / f"{round_}", folder / f"{round_}.said"
        round_ += 1
        for killed_before in itertools.count():
            child = os.fork()
            if not child:
                answer_all(make, says, log, said)
                os._exit(0)
            # a busy machine would never let it end
            if killed_before < kills:
                time.sleep(chance.uniform(0, 1.2 * seconds))
                os.kill(child, signal.SIGKILL)
            if os.waitpid(child, 0)[1] == 0:
                break
            done += 1
            acknowledged, kept = said.read_text().split() if said.exists() else [], []
            if log.exists():
                kept = [row[0] for row in told(log)]
            if (
                not set(acknowledged) <= set(kept)
                or len(set(kept)) != len(kept)
                or len(acknowledged) > len(kept)
            ):
                wrong.append(f"{log}: acknowledged {acknowledged}, kept {kept}")
        if told(log) != expected or outcome(answer_all(make, says, log, said)) != best:
            wrong.append(f"{log}: ended otherwise than the undisturbed session")
        answers += len(expected)
        unused += sum(not row[2] for row in expected)
    return {"killed": done, "answers": answers, "unused": unused, "wrong": wrong}


if __name__ == "__main__":
    folder, kills, seed, size = sys.argv[1:]
    print(json.dumps(killed(Path(folder), int(kills), int(seed), size == "small")))
