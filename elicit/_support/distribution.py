"""The installed distribution: its version, and the command that installs a missing package."""

from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as installed_version

NAME = "elicit-qlearn"
_EXTRAS = dict.fromkeys(("joblib", "matplotlib", "pandas", "tqdm"), "ablation")
_EXTRAS |= dict.fromkeys(("gymnasium", "mo_gymnasium", "pygame"), "gym")
_EXTRAS |= dict.fromkeys(("starlette", "uvicorn"), "web")
_EXTRAS |= {"anywidget": "widget"}
_EXTRAS |= dict.fromkeys(("stable_baselines3", "torch"), "sb3")


def version() -> str:
    """Return the version of the installed distribution, which contains elicit and qlearn.

    Raises AttributeError if it is not installed: ``__version__`` of a package is read by this
    function, and is then missing like any other name.
    """
    try:
        return installed_version(NAME)
    except PackageNotFoundError:
        where = "in a clone: pip install -e '.[all]'"
        raise AttributeError(
            f"{NAME} is not installed, so its version is not known; {where}"
        ) from None


def with_advice(error: ModuleNotFoundError) -> ModuleNotFoundError:
    """Return an import error with the command that installs the missing extra in its message."""
    package = (error.name or "").split(".")[0]
    if package not in _EXTRAS:
        return error
    advice = f"{package} is not installed: pip install '{NAME}[{_EXTRAS[package]}]'"
    return ModuleNotFoundError(advice, name=error.name, path=error.path)
