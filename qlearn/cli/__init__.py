"""The command ``qlearn``. Imports from all of qlearn, each command when it is called."""
