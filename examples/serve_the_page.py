"""The page of a session, served from your own program, about a problem of your own.

    python examples/serve_the_page.py [answers.jsonl [port]]

A machine runs well, runs slowly, stands still, or is being repaired; when to repair it depends on
how bad these days are, which a person says in the browser. The program prints an address that lets
in one browser, waits for Enter, and goes on with what was learned. Needs the extra: pip install
'elicit-qlearn[web]'.
"""

import sys

import numpy as np

import elicit
import qlearn
from elicit.person.hosts.web import WebServer

LEVELS = ("standing still", "in repair", "slow", "running well")  # worst first
STATES = ("good", "worn", "broken")
ACTIONS = ("run", "repair")
TRANSITIONS = np.array(  # from a state, by an action, to a state
    [
        [[0.7, 0.3, 0.0], [1.0, 0.0, 0.0]],
        [[0.0, 0.9, 0.1], [0.4, 0.6, 0.0]],
        [[0.0, 0.0, 1.0], [0.2, 0.0, 0.8]],
    ]
)
LEVEL_OF = np.array([[3, 1], [2, 1], [0, 1]])  # in a state, by an action
MDP = qlearn.OrdinalMDP.from_dense(TRANSITIONS, LEVEL_OF, 0.9, LEVELS)
WORDS = elicit.Words(
    "days", "are", "A machine", "Choose the ten days that you would rather have.", side="plan"
)


def make(known):
    """Return the asker that knows these answers."""
    comparator = elicit.PosteriorComparator(k=len(LEVELS))  # it allows for errors
    return qlearn.InteractivePolicyIteration(
        MDP, comparator, bags=elicit.Bags(days=10), known=known
    )


def report(result):
    """Sentences for the last screen."""
    plan = [
        f"{state}: {ACTIONS[action]}" for state, action in zip(STATES, result.policy, strict=True)
    ]
    return [
        f"The plan: {', '.join(plan)}.",
        f"It loses at most {result.loss_bound:.2%} of the value range.",
    ]


def main(path, port):
    """Serve until Enter, then say what came out."""
    subject = elicit.Subject(LEVELS, WORDS, report=report)
    with elicit.Session(make, path) as session:
        with WebServer(session, subject, port=port) as server:
            print(server.new_address(), flush=True)
            print("Open this address, answer, and press Enter here.", flush=True)
            sys.stdin.readline()
        print(session.status())  # the server is closed now: a session is for one thread at a time
        print("\n".join(report(session.result())))


if __name__ == "__main__":
    main(
        sys.argv[1] if len(sys.argv) > 1 else "answers.jsonl",
        int(sys.argv[2]) if len(sys.argv) > 2 else 0,
    )
