"""A session that can be left at any moment, even by a power cut, and picked up again.

    python examples/resume_a_session.py [answers.jsonl]

Answer a few questions about six courses of treatment, leave (Ctrl+D), and start the program again:
it goes on where you were, and asks nothing twice. It shows that a session stands on its log alone:
a function that makes who asks, a file.
"""

import sys

import numpy as np

import elicit

LEVELS = ("died", "severe", "mild", "well")  # worst first
COURSES = {  # of ten patients: so many at each level
    "watch": [3, 2, 1, 4],
    "tablets": [0, 5, 4, 1],
    "injections": [3, 3, 2, 2],
    "surgery": [5, 3, 0, 2],
    "surgery then tablets": [4, 0, 4, 2],
    "diet": [1, 5, 2, 2],
}
WORDS = elicit.Words("patients", "fare", question="which is better off?")
MEANS = {"a": "a", "b": "b", "e": "equal", "?": "cannot tell"}


def make(known):
    """Return the asker that knows these answers."""
    vectors = np.array(list(COURSES.values())) / 10
    comparator = elicit.PosteriorComparator(k=len(LEVELS))  # it allows for errors
    return elicit.choose(
        vectors, comparator, order=True, names=list(COURSES), labels=LEVELS, known=known
    )


def main(path):
    """Ask until there are no more questions, or the person leaves."""
    with elicit.Session(
        make, elicit.AnswerLog(path, header={"labels": LEVELS}), who="me"
    ) as session:
        print(session.status())
        try:
            while query := session.question():
                shown = elicit.showing.show(query, WORDS)
                session.shown(shown.id, shown.swapped)
                print(f"\n{shown.text()}\n")
                said = input("a, b, e: equal, ?: cannot tell, u: undo\n> ").strip().lower()
                if said == "u" and len(session.log):
                    session.undo()
                elif said in MEANS:
                    session.answer(
                        query.id, shown.verdict(MEANS[said])
                    )  # on the disk when this returns
        except (EOFError, KeyboardInterrupt):
            print(f"\nLeft. {session.status()}. Start again to go on.")
            return
        result = session.result()
        print(f"\nBest first: {', '.join(list(COURSES)[i] for i in result.order)}.")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "answers.jsonl")
