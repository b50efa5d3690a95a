"""Conformance tests for your own comparator or tutor: run them in your test suite.

    from elicit.testing import check_comparator, check_tutor

    def test_mine() -> None:
        check_comparator(MyComparator(k=5))

Each raises an AssertionError that names the input, the result, and the contract's demand.

A comparator must have five members. With these it works in every learner, in ``choose`` and in
every report. ``elicit.as_differences(d, k)`` turns the argument of its methods into an array, or
raises an error if it is none.

    k                       the number of levels
    values                  (k,) the best single guess at the scale, from 0 to 1, not decreasing,
                            the same each time
    bounds(d)               lo (n,), hi (n,) of d.e, of differences d (n, k) = left - right; -inf,
                            inf: nothing known
    compare(d)              (n,) int8 verdicts: 1 left is better, -1 right is, 0 equal, 2 only the
                            tutor can tell. A verdict by dominance (eq. 4) comes first; level 1 and
                            the length of d do not matter
    update(answers)         a new comparator that also knows these ``elicit.Answers``; the old one
                            stays as it was

These further members are optional, and are used if they exist:

"""

from textwrap import fill

from elicit.model.comparator_parts import OPTIONAL_PARTS
from elicit.testing.comparator_checks import check_comparator
from elicit.testing.differences import sample_differences
from elicit.testing.tutor_checks import check_tutor

__all__ = ["check_comparator", "check_tutor", "sample_differences"]

if __doc__ is not None:  # python -OO leaves it out
    __doc__ += "".join(
        fill(
            f"{part.gives}. {part.use} In {', '.join(part.offered_by)}.",
            120,
            initial_indent=f"    {part.signature:24}",
            subsequent_indent=" " * 28,
        )
        + "\n"
        for part in OPTIONAL_PARTS
    )
