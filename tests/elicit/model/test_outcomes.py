"""One status for learners, choices and trainings, which people can read."""

import pytest

import elicit
import qlearn
from elicit import Status


def test_both_packages_have_the_same_and_nobody_has_another() -> None:
    assert qlearn.Status is elicit.Status
    assert not hasattr(qlearn, "TrainingStatus")
    assert "Status" in elicit.__all__
    assert "Status" in qlearn.__all__


@pytest.mark.parametrize("status", Status)
def test_a_status_says_whether_it_is_over_and_is_a_sentence(status: Status) -> None:
    begins = status.value.split(":")[0].split(",")[0].split(" at ")[0]
    assert begins in ("not finished", "finished", "stopped")
    assert (begins == "not finished") == (status in (Status.WAITING, Status.TRAINING))
    assert status.sentence == status.value[0].upper() + status.value[1:] + "."
    assert not status.value.endswith(".")


def test_no_two_say_the_same() -> None:
    assert len(Status) == len({status.value for status in Status}) == len(Status.__members__)
