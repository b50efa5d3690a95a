"""``python -m qlearn`` is the command ``qlearn``."""

import sys

from qlearn.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
