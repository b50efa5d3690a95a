"""Chooses how much the tests try, before any of them is imported, and how many run at a time."""

import importlib
import os
import sys
from contextlib import suppress

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


def pytest_collection(session: pytest.Session) -> None:
    """Let each worker import the files of tests from another one on.

    In a fresh clone pytest rewrites every file for its assertions, which takes as long as importing
    all else does. Workers that went through the files in step would each rewrite all of them.
    """
    worker = getattr(session.config, "workerinput", None)
    if worker is None:
        return
    root = session.config.rootpath
    places = [root / argument.split("::")[0] for argument in session.config.args]
    files = [file for place in places for file in sorted(place.rglob("test_*.py"))]
    begin = int(worker["workerid"].removeprefix("gw")) * len(files) // worker["workercount"]
    for file in files[begin:] + files[:begin]:
        with suppress(Exception, pytest.skip.Exception):  # which collecting it will say
            importlib.import_module(".".join(file.relative_to(root).with_suffix("").parts))
