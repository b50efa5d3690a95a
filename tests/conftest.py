"""Chooses how much the tests try, before any of them is imported, and how many run at a time."""

import os
import sys

import pytest

from tests import thoroughness


def pytest_configure(config: pytest.Config) -> None:
    thoroughness.choose(config.option.markexpr)
    # nbformat imports it for one format that no notebook has: more than a second in each process
    sys.modules["rfc3987_syntax"] = None  # type: ignore[assignment]


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """Return one more than there are cores: many tests wait for a program that they started."""
    return len(os.sched_getaffinity(0)) + 1 if hasattr(os, "sched_getaffinity") else 3
