"""Chooses how much the tests try, before any of them is imported."""

import pytest

from tests import thoroughness


def pytest_configure(config: pytest.Config) -> None:
    thoroughness.choose(config.option.markexpr)
