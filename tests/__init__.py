"""Tests are of compiled code, unless they say otherwise; processes that they start, too."""

import os

os.environ.setdefault("ELICIT_COMPILE_FIRST", "1")
