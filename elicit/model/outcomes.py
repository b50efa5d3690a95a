"""The status of a learner, a choice or a training, as sentences."""

from enum import Enum


class Status(Enum):
    """The status of a learner, a choice or a training. Values are sentences for people.

    ``WAITING`` and ``TRAINING`` are not finished. ``CONVERGED`` is proven within the tolerance. All
    others say what is missing, and ``loss_bound`` of the result how much that can matter.
    """

    WAITING = "not finished: a question waits for the tutor; answer what ask() returns"
    TRAINING = "not finished: it waits for a policy trained on to_train(); bring it with add"
    DONE = "finished: all steps are done, and nothing is left to ask"
    CONVERGED = "finished: the bound on the policy's loss is within the tolerance"
    CERTIFIED = "finished: no plausible scale lets the policy lose more than max_loss"
    BOUNDED = (
        "finished: the policy is within the tolerance (or max_loss) by the comparator's bounds, "
        "which it does not say "
        "hold for all pairs at once: with what confidence is unknown"
    )
    SETTLED = (
        "finished: but for optimality_gap and the errors of measured shares, the policy is within "
        "the tolerance; "
        "loss_bound counts these too, if each training came within that gap of its optimum"
    )
    UNPROVEN = (
        "finished: the policy would be within the tolerance if each training had come to its "
        "optimum, but how near it "
        "came nobody has said, so loss_bound is nan: give optimality_gap to have one"
    )
    GAP_BROKEN = (
        "finished, but a later policy beat an earlier training at its own scale by more than "
        "optimality_gap, see "
        "observed_gap: that gap does not hold, so loss_bound is nan; train longer, or give a wider "
        "gap"
    )
    CALLED_EQUAL = (
        "stopped: the tutor calls every pair equal that could still matter, or may call it equal "
        "by the comparator's tie; loss_bound says how much may be lost"
    )
    UNSURE = (
        "finished, but the tutor could not tell some pairs apart (cannot_tell): the one that was "
        "ahead stayed ahead, "
        "so more than the tolerance may be lost; loss_bound says how much"
    )
    GUESSED = (
        "stopped at the limit of questions: what was still open went by the best guess at the "
        "scale; raise max_queries"
    )
    EXHAUSTED = (
        "stopped: the tutor has answered all that could still matter, or could not tell; "
        "loss_bound says how much may be lost; simple questions may tell more (bags=)"
    )
    SWEEP_LIMIT = (
        "stopped at the limit of sweeps before converging: raise max_sweeps or the tolerance"
    )
    TRAINING_LIMIT = "stopped at the limit of trainings: raise max_trainings or the tolerance"
    TIME_LIMIT = (
        "stopped at the limit of seconds: loss_bound says how much may be lost; raise max_seconds "
        "or the tolerance"
    )

    @property
    def sentence(self) -> str:
        """The value as a full sentence, with a capital letter and a full stop."""
        return f"{self.value[0].upper()}{self.value[1:]}."


def assumed_of_answers(wrong: int, whose: str) -> str:
    """Return a condition, as text: a proof holds if at most ``wrong`` of the answers are wrong.

    Parameters
    ----------
    wrong : int
        Number of answers that may be wrong.
    whose : str
        "your" or "the".
    """
    if not wrong:
        return f"if {whose} answers are right"
    some, verb = ("one", "is") if wrong == 1 else (wrong, "are")
    return f"even if {some} of {whose} answers {verb} wrong"
