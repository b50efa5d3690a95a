"""The widget in a real JupyterLab: a session by mouse and by keyboard, across a reload, on the
disk.
"""

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import nbformat
import pytest
from nbformat.v4 import new_code_cell, new_notebook

from elicit import AnswerLog, Verdict
from tests.browser_cases import browser
from tests.interpreter import ROOT

VALUES = {"died": 0, "severe": 4, "mild": 7, "well": 10}  # by these the person answers
MAKES = """
import elicit, numpy as np
vectors = np.array([[3, 2, 1, 4], [0, 5, 4, 1], [3, 3, 2, 2], [5, 3, 0, 2], [4, 0, 4, 2], [1, 5, 2, 2]]) / 10
def make(known):
    return elicit.choose(vectors, elicit.PolytopeComparator(4), order=True, known=known)
session = elicit.Session(make, "answers.jsonl")
subject = elicit.Subject(("died", "severe", "mild", "well"), elicit.Words("patients", "fare", "Six courses"), least=0)
elicit.InterviewWidget(session, subject)
"""  # noqa: E501
READS = "print('the best is', session.result().best, 'after', session.result().asked)"
BEST = 1
PATIENCE = 240_000  # ms; on a fresh machine the kernel compiles first


@contextmanager
def jupyterlab(folder: Path, *sources: str) -> Iterator[str]:
    """The address of a JupyterLab that has a notebook of these cells open and nothing of the user's
    own.
    """
    cells = [new_code_cell(source.strip()) for source in sources]
    python = {"kernelspec": {"name": "python3", "display_name": "Python 3"}}
    nbformat.write(new_notebook(cells=cells, metadata=python), folder / "session.ipynb")
    own = folder / "jupyter"
    quiet = own / "settings" / "@jupyterlab" / "apputils-extension"
    quiet.mkdir(parents=True)
    (quiet / "notification.jupyterlab-settings").write_text('{"fetchNews": "false"}')
    places = {
        "JUPYTER_CONFIG_DIR": "config",
        "JUPYTER_DATA_DIR": "data",
        "JUPYTER_RUNTIME_DIR": "runtime",
        "JUPYTERLAB_SETTINGS_DIR": "settings",
        "JUPYTERLAB_WORKSPACES_DIR": "workspaces",
        "IPYTHONDIR": "ipython",
    }
    more = {name: str(own / place) for name, place in places.items()} | {"PYTHONPATH": str(ROOT)}
    options = [
        "--no-browser",
        "--ServerApp.token=secret",
        "--ServerApp.port=0",
        "--ServerApp.allow_root=True",
    ]
    with open(own / "log", "w") as log:
        server = subprocess.Popen(
            [sys.executable, "-m", "jupyterlab", *options, "--LabApp.extension_manager=readonly"],
            cwd=folder,
            env={**os.environ, **more},
            stdout=log,
            stderr=log,
        )
    try:
        end = time.monotonic() + 60
        while (
            not (found := list((own / "runtime").glob("jpserver-*.json")))
            or not found[0].read_text()
        ):
            stopped = server.poll() is not None or time.monotonic() > end
            assert not stopped, (own / "log").read_text()
            time.sleep(0.05)
        yield json.loads(found[0].read_text())["url"]
    finally:
        server.terminate()
        server.wait(timeout=30)


def opened(page: Any, url: str) -> None:
    """Open the notebook, and wait until its kernel is idle: cells run before that are lost."""
    page.goto(f"{url}doc/tree/session.ipynb?token=secret")
    end = time.monotonic() + 60
    while True:
        kernels = page.request.get(f"{url}api/kernels?token=secret").json()
        if kernels and kernels[0]["execution_state"] == "idle" and kernels[0]["connections"]:
            break
        assert time.monotonic() < end, kernels
        page.wait_for_timeout(50)
    page.wait_for_selector('.jp-Notebook-ExecutionIndicator[data-status="idle"]')


def run_cell(page: Any, n: int) -> None:
    """Run the nth cell."""
    page.locator(".jp-Notebook .cm-content").nth(n).click()
    page.keyboard.press("Shift+Enter")


def truthful(page: Any) -> str:
    """The side, "a" or "b", that is worth more by the values, read from what the question shows."""
    rows = [card.locator("li").all() for card in page.locator(".elicit .card").all()]
    a, b = (
        sum(
            int(row.locator(".n").inner_text()) * VALUES[row.locator(".label").inner_text()]
            for row in side
        )
        for side in rows
    )
    return "a" if a > b else "b"


def stands(page: Any, answered: int) -> bool:
    """Wait until so many answers stand and the next screen can be used; whether it has a
    question.
    """
    question = page.locator(".elicit h1", has_text=f"Question {answered + 1}.")
    end = page.locator(".elicit h1", has_text="no more questions")
    question.or_(end).wait_for(timeout=PATIENCE)
    page.locator(".elicit .pick:enabled").first.wait_for()
    return not end.is_visible()


@pytest.mark.slow
def test_a_session_by_mouse_and_keyboard_goes_on_after_a_reload_and_each_answer_is_in_its_log(
    tmp_path,
):
    complaints: list[str] = []
    said: list[str] = []
    with browser() as chromium, jupyterlab(tmp_path, MAKES, READS) as url:
        page = chromium.new_page()
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("console", lambda line: line.type == "error" and complaints.append(line.text))
        opened(page, url)
        run_cell(page, 0)
        page.locator(".elicit h1", has_text="Teach the program").wait_for(timeout=PATIENCE)
        page.locator(".elicit .form .pick:enabled").click()
        page.locator(".elicit h1", has_text="Practice").wait_for(timeout=PATIENCE)
        page.locator(f".elicit [data-choice={truthful(page)}]").click()
        assert stands(page, 0)
        said.append(truthful(page))
        page.locator(f".elicit [data-choice={said[-1]}]").click()
        assert stands(page, 1)
        for key in "xdd":  # which cut and delete cells where the notebook hears them
            page.keyboard.press(key)
        page.keyboard.press("Control+s")  # which the notebook must hear
        page.get_by_text("Saving completed").wait_for()
        page.reload()
        assert stands(page, 1)
        page.locator(".elicit h1").click()
        while stands(page, len(said)):
            said.append(truthful(page))
            page.keyboard.press("ArrowLeft" if said[-1] == "a" else "b")
        assert page.locator(".jp-Notebook .jp-CodeCell").count() == 2
        run_cell(page, 1)
        page.get_by_text(f"the best is {BEST} after {len(said)}").wait_for()
        assert complaints == []
    assert len(said) > 2
    with AnswerLog.read(tmp_path / "answers.jsonl") as log:
        assert [entry.answer.verdict for entry in log] == [
            Verdict.BETTER if (choice == "a") != entry.answer.swapped else Verdict.WORSE
            for choice, entry in zip(said, log, strict=True)
        ]
