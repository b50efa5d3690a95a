"""The page on raters: whose answers are random, and what a row of the page says."""

import numpy as np

from benchmarks.people import raters


def test_only_the_last_person_answers_at_random():
    answers = raters.answers_of_five(seed=0, each=2000)
    right = {}
    for who in raters.PEOPLE:
        own = answers.of_person(who)
        better = own.d[:, -1] - own.d[:, 0]  # more of the best level, less of the worst
        clear = np.abs(better) > 1
        assert len(own) == 2000
        assert clear.sum() > 50
        right[who] = np.mean(own.y[clear] == np.sign(better[clear]))
    assert 0.35 < right.pop("eve") < 0.65
    assert min(right.values()) > 0.9


def test_a_row_has_the_mean_changes_and_their_ratio():
    assert raters.row(20, np.array([4.0, 6.0]), np.array([1.0, 1.0])) == [
        "20",
        "5.0 ± 12.7",
        "1.0 ± 0.0",
        "0.20",
    ]
