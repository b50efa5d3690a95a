"""Each package of an extra is needed only where it is used, and said there if it is missing.

One interpreter does it for all of them; slow tests beside what needs a package do it one by one.
"""

from tests.interpreter import run


def test_what_is_missing_is_named_and_everything_else_works() -> None:
    code = """
import sys
missing = ["matplotlib", "anywidget", "starlette", "uvicorn"]
for package in missing:
    sys.modules[package] = None
from elicit import *
import elicit, elicit.plot
from elicit.person.hosts.web import WebServer
print("InterviewWidget" in dir(elicit))
def says(call):
    try:
        call()
    except ImportError as error:
        print(error)
says(lambda: elicit.plot.scale_intervals(elicit.Dominance(3)))
says(lambda: elicit.InterviewWidget)
says(lambda: WebServer(None, None))
del sys.modules["uvicorn"]
says(lambda: WebServer(None, None))
elicit.PolytopeComparator(4, prior=["e3 >= 0.2"])
from elicit import scale_variable
print("cvxpy" in sys.modules)
"""
    advice = "is not installed: pip install 'elicit-qlearn"
    assert run(code) == [
        "True",
        "plots need matplotlib: pip install 'elicit-qlearn[ablation]'",
        f"anywidget {advice}[widget]'",
        f"uvicorn {advice}[web]'",
        f"starlette {advice}[web]'",
        "False",
    ]
