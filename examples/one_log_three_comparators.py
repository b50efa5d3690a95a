"""One log and three comparators: what was answered serves whoever learns from it next.

    python examples/one_log_three_comparators.py [answers.jsonl]

The same person is asked three times to order a list: for the polytope, which takes each answer for
right; for the polytope that holds even if one answer is wrong; and for a posterior, which allows
for slips. The later ones know what was said before and ask only what is still open to them.
"""

import sys

import numpy as np

import elicit

LEVELS = ("died", "severe", "moderate", "mild", "well")  # worst first
K = len(LEVELS)
VECTORS = np.random.default_rng(2).multinomial(10, np.full(K, 1 / K), size=8) / 10
WORDS = elicit.Words("patients", "fare", question="which is better off?")
MEANS = {"a": "a", "b": "b", "e": "equal", "?": "cannot tell"}
COMPARATORS = {
    "polytope": elicit.PolytopeComparator(K),
    "polytope, one wrong": elicit.PolytopeComparator(K, wrong=1),
    "posterior": elicit.PosteriorComparator(K, seed=0),
}


def asking(comparator):
    """Makes who asks for this comparator, knowing some answers."""
    return lambda known: elicit.choose(VECTORS, comparator, order=True, known=known)


def ask_all(session):
    """Put every question to the person at the terminal."""
    while query := session.question():
        shown = elicit.showing.show(query, WORDS, labels=LEVELS)
        session.shown(shown.id, shown.swapped)
        said = input(f"\n{shown.text()}\n\na, b, e: equal, ?: cannot tell\n> ").strip().lower()
        if said in MEANS:
            session.answer(query.id, shown.verdict(MEANS[said]))


def main(path):
    """A session for each comparator, one after the other, on the same log."""
    with elicit.AnswerLog(path, K, {"labels": LEVELS}) as log:
        for name, comparator in COMPARATORS.items():
            before = len(log)
            session = elicit.Session(asking(comparator), log)
            ask_all(session)
            result = session.result()
            print(f"\n{name}: knew {before} answers and asked for {len(log) - before} more.")
            print(
                f"Best first: {result.order}; the best is so to within {result.loss_bound:.1%} of "
                "the value range."
            )
            for conflict in session.conflicts():
                print(f"{len(conflict)} of the answers do not go together.")


if __name__ == "__main__":
    try:
        main(sys.argv[1] if len(sys.argv) > 1 else "answers.jsonl")
    except (EOFError, KeyboardInterrupt):
        print("\nLeft. Start again to go on.")
