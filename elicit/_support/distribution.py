"""The installed distribution: its version, and the command that installs a package that is
missing.
"""

from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as installed_version

NAME = "elicit-qlearn"
_EXTRAS = dict.fromkeys(("joblib", "matplotlib", "pandas", "tqdm"), "ablation")
_EXTRAS |= dict.fromkeys(("gymnasium", "mo_gymnasium", "pygame"), "gym")
_EXTRAS |= dict.fromkeys(("starlette", "uvicorn"), "web")
_EXTRAS |= {"anywidget": "widget"}
_EXTRAS |= dict.fromkeys(("stable_baselines3", "torch"), "sb3")


def version() -> str:
    """The version of the installed distribution, which both packages are parts of. Raises
    AttributeError where it is not installed, so that asking a module for ``__version__`` then fails
    as for any name that it lacks."""
    try:
        return installed_version(NAME)
    except PackageNotFoundError:
        where = "in a clone: pip install -e '.[all]'"
        raise AttributeError(
            f"{NAME} is not installed, so its version is not known; {where}"
        ) from None


def with_advice(error: ModuleNotFoundError) -> ModuleNotFoundError:
    """The same error, where a package of an extra is missing with the command that installs it."""
    package = (error.name or "").split(".")[0]
    if package not in _EXTRAS:
        return error
    advice = f"{package} is not installed: pip install '{NAME}[{_EXTRAS[package]}]'"
    return ModuleNotFoundError(advice, name=error.name, path=error.path)
