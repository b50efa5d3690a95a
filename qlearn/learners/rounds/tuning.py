"""Settings of policy iteration that trade questions for CPU time.

Loss bounds hold whatever the settings are.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Tuning:
    """Numbers that determine which advantages are looked at, and when.

    benchmarks/RESULTS-question-rules.md compares the rules for questions. RESULTS-scale.md and
    RESULTS-growth.md show the time that large models take.
    """

    matters: float = 0.5
    """An advantage counts for a strategy if it exceeds this part of the tolerance. Taken once, in a
    single state, it then costs that much. With the least advantage that could ever matter,
    tolerance (1 - discount), a fifth more questions were asked."""

    signs: int = (
        12  # number of the best advantages to ask about whose signs a simple question should tell
    )
    # days of the mixtures of levels that are asked about once all pairs are; the first number that
    # leaves few enough questions to compute is taken
    days: tuple[int, ...] = (60, 24, 12, 6, 4, 2)
    mixtures: int = 5000
    # cuts are asked if at most this weight of the scales sees a better action
    undecided: float = 0.25
    confirming: float = 0.5  # the same for questions that confirm answers which may be wrong
    closed: int = (
        200  # number of advantages, those with the greatest bounds, that a cut is meant to close
    )
    close: float = 0.3  # the part of the tolerance to which a cut should reduce them

    sample: int = 1000  # states in a sample
    pool: int = (
        4000  # number of advantages, those with the greatest bounds, that a question may be about
    )
    questions_a_solution: int = 4  # questions until the policy is solved for again
    questions_a_slow_solution: int = 8  # the same for models of more than ``slow`` states
    slow: int = 30_000  # states
    error: float = 0.02  # the part of the tolerance that errors in V and in the bound may use up
    # factor by which the errors of V and of the policy may be larger, at the sampled states, while
    # questions are chosen than in a proof; with 50, 52.4 questions were asked in place of 50.8
    # (40,000 states, seeds 1 to 10: no clear difference)
    rough: float = 10.0
    # the same for models of more than ``slow`` states; with 10, 50 and 200 in its place, 51.7, 52.8
    # and 54.3 questions were asked in 7.2, 6.8 and 6.4 s (40,000 states, seeds 1 to 10; 200 against
    # 10: 2.6 +- 5.2 questions); with 100, 3.3 +- 3.9 more than before states were screened, when it
    # was 10 (100,000 states, seeds 1 to 9)
    rough_if_slow: float = 30.0


TUNING = Tuning()
