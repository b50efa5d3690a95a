"""The notebooks run without a word on the error stream.

Committed outputs are those of their code at full size.
"""

import ast
import json
import os
import re
import runpy
import shutil
import sys
import tempfile
from functools import cache
from pathlib import Path
from pkgutil import resolve_name

import matplotlib
import nbformat
import pandas as pd
import pytest
from nbclient.exceptions import CellExecutionError
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook, new_output

from benchmarks import stamps
from elicit import plot
from notebooks import execute
from tests.interpreter import printed_here

REFERENCE = execute.HERE.parent / "docs" / "reference"
NOTEBOOKS = sorted(execute.HERE.glob("*.ipynb"))
assert NOTEBOOKS
each_notebook = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
QUICK = "07_you_are_the_tutor"  # the one that runs in the least time
READS_THE_SETTING = 'import os\nprint(os.environ.get("NOTEBOOK_SETTING", "full"))'


def code_cells(notebook):
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def outputs(notebook):
    return [output for cell in code_cells(notebook) for output in cell.outputs]


def complaints(notebook):
    """Errors, and whatever was printed to the error stream: warnings."""
    found = outputs(notebook)
    return [
        o
        for o in found
        if o.output_type == "error" or (o.output_type == "stream" and o.name == "stderr")
    ]


def said(notebook):
    """All output but pictures, whose bytes depend on fonts and versions."""
    return [
        {name: data for name, data in output.get("data", output).items() if name != "image/png"}
        for output in outputs(notebook)
    ]


def machine_paths(text):
    """Return the texts that look like a path on the machine that ran the notebook."""
    places = {
        str(Path.home()),
        str(execute.HERE.parent),
        sys.prefix,
        tempfile.gettempdir(),
        os.sep + "tmp",
    }
    found = [place for place in places if len(place) > 1 and place in text]
    return found + re.findall(
        r"(?<![\w.:/])/(?:home|Users|root|var|opt|mnt|usr)/\S*|\b[A-Z]:\\\\\S*", text
    )


def notebook_of(*sources):
    cells = [new_code_cell(source, id=f"cell-{i}") for i, source in enumerate(sources)]
    return new_notebook(cells=[new_markdown_cell("# Title", id="title"), *cells])


def put(folder, name, *sources):
    path = folder / name
    nbformat.write(notebook_of(*sources), path)
    return path


def test_the_code_of_one_runs_at_the_small_setting_without_a_warning(tmp_path, monkeypatch):
    """It does so here, without a kernel, which takes seconds to start."""
    notebook = execute.read(execute.HERE / f"{QUICK}.ipynb")
    monkeypatch.setenv("NOTEBOOK_SETTING", "small")
    monkeypatch.setattr("matplotlib.pyplot.show", lambda: None)
    monkeypatch.chdir(tmp_path)
    with matplotlib.rc_context(), pd.option_context("display.max_colwidth", 100):
        shown = printed_here("\n".join(cell.source for cell in code_cells(notebook)))
    assert shown.startswith("setting: small\n")
    assert "0 conflicts left" in shown
    assert os.listdir(tmp_path) == []


@pytest.mark.slow
@each_notebook
def test_it_runs_at_the_small_setting_without_a_warning(path, tmp_path):
    committed = path.read_bytes()
    copy = Path(shutil.copy(path, tmp_path))
    ran = execute.execute(execute.read(copy), "small", tmp_path)
    assert complaints(ran) == []
    assert ran.metadata.executed.setting == "small"
    assert [cell.execution_count for cell in code_cells(ran)] == list(
        range(1, len(code_cells(ran)) + 1)
    )
    assert "setting: small" in json.dumps(said(ran))
    assert os.listdir(tmp_path) == [path.name]  # it leaves nothing behind
    assert path.read_bytes() == committed


@each_notebook
def test_the_committed_one_was_run_in_full_in_order_with_this_code_and_names_no_place_of_a_machine(
    path,
):
    notebook = execute.read(path)
    nbformat.validate(notebook)
    cells = code_cells(notebook)
    assert [cell.execution_count for cell in cells] == list(range(1, len(cells) + 1))
    assert complaints(notebook) == []
    assert any("image/png" in output.get("data", {}) for output in outputs(notebook))
    assert notebook.metadata.executed.pop("stamp").startswith("Made ")
    assert notebook.metadata.executed == {"setting": "full", "code": execute.code_hash(notebook)}
    assert "setting: full" in json.dumps(said(notebook))
    assert notebook == execute.clean(
        execute.read(path), "full"
    )  # beside the stamp no times, no names of kernels
    ids = [cell.id for cell in notebook.cells]
    assert len(set(ids)) == len(ids)
    assert machine_paths("\n".join(cell.source for cell in notebook.cells)) == []
    assert machine_paths(json.dumps(said(notebook))) == []
    assert 'os.environ.get("NOTEBOOK_SETTING", "full")' in cells[0].source
    assert max(len(cell.source.splitlines()) for cell in notebook.cells) <= 60
    assert notebook.cells[0].cell_type == "markdown"


@pytest.mark.slow
@each_notebook
def test_a_full_run_says_what_is_committed(path, tmp_path):
    notebook = execute.read(path)
    again = execute.execute(execute.read(path), "full", tmp_path)
    assert said(again) == said(notebook)
    assert again.metadata.executed.code == notebook.metadata.executed.code


def test_the_picture_of_the_tagged_cell_is_attached_to_the_first_cell():
    notebook = notebook_of("1", "2")
    for cell, picture in zip(code_cells(notebook), ("one", "two"), strict=True):
        cell.outputs = [
            new_output("stream", text="drawn"),
            new_output("display_data", {"image/png": picture}),
        ]
    assert "attachments" not in execute.with_picture(notebook).cells[0]
    notebook.cells[2].metadata["tags"] = [execute.PICTURE]
    assert execute.with_picture(notebook).cells[0].attachments == {
        "picture.png": {"image/png": "two"}
    }
    nbformat.validate(notebook)


def test_it_runs_this_interpreter_whatever_kernels_there_are_and_touches_no_home(
    tmp_path, monkeypatch
):
    home, elsewhere, here = tmp_path / "home", tmp_path / "jupyter", tmp_path / "here"
    wrong = elsewhere / "kernels" / "python3"
    for folder in (home, wrong, here):
        folder.mkdir(parents=True)
    (wrong / "kernel.json").write_text(
        '{"argv": ["false"], "display_name": "wrong", "language": "python"}'
    )
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.setenv("JUPYTER_PATH", str(elsewhere))
    monkeypatch.setenv("MPLBACKEND", "agg")
    asks = (
        "import sys, os, matplotlib\nprint(sys.executable, os.getcwd(), matplotlib.get_backend())"
    )
    ran = execute.execute(notebook_of(READS_THE_SETTING, asks), "small", here)
    setting, rest = (output.text.strip() for output in outputs(ran))
    executable, folder, backend = rest.split()
    assert setting == "small"
    assert executable == sys.executable
    assert Path(folder) == here.resolve()
    assert backend in ("inline", "module://matplotlib_inline.backend_inline")
    assert [
        p for p in home.rglob("*") if p.is_file() and "matplotlib" not in str(p)
    ] == []  # fonts may be cached


@pytest.mark.slow
def test_it_writes_the_same_bytes_whenever_it_runs_and_only_if_all_went_well(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr(execute, "HERE", tmp_path)
    prints = (
        "import time\nprint('a', flush=True)\ntime.sleep(0.2)\nprint('b')\n{'x', 'y', 'z'}, "
        "hash('x')"
    )
    good = put(tmp_path, "01_good.ipynb", READS_THE_SETTING, prints)
    bad = put(tmp_path, "02_bad.ipynb", READS_THE_SETTING, "1 / 0", "2")
    before = bad.read_bytes()
    assert execute.main([]) == 1
    assert bad.read_bytes() == before
    told = capsys.readouterr()
    assert "02_bad.ipynb failed" in told.err
    assert "ZeroDivisionError" in told.err
    assert "01_good.ipynb" in told.out

    first = good.read_bytes()
    ran = execute.read(good)
    stamp = stamps.of(good)
    assert (stamp.command, stamp.sources) == (
        "python -m notebooks.execute 01_good",
        stamps.sources(str(good)),
    )
    assert ran.metadata.executed == {
        "setting": "full",
        "code": execute.code_hash(ran),
        "stamp": str(stamp),
    }
    assert [cell.execution_count for cell in code_cells(ran)] == [1, 2]
    assert [o.text for o in outputs(ran) if o.get("name") == "stdout"] == ["full\n", "a\nb\n"]
    assert "execution" not in first.decode().replace("execution_count", "")
    assert execute.main(["01_good"]) == 0
    assert good.read_bytes() == first
    assert execute.main(["--setting", "small", "01_good.ipynb"]) == 0
    assert execute.read(good).metadata.executed.setting == "small"
    assert sorted(os.listdir(tmp_path)) == ["01_good.ipynb", "02_bad.ipynb"]


def test_machine_paths_are_told_from_fractions():
    assert machine_paths("10 / 20 / 30 and 1/2 and https://doi.org/home/x and (1 - y)/usage") == []
    for place in (
        "see /home/ann/x.py",
        "/Users/ann/x",
        json.dumps("C:\\Users\\ann"),
        str(execute.HERE),
    ):
        assert machine_paths(place)


def test_what_it_cannot_do_it_says(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(execute, "HERE", tmp_path)
    with pytest.raises(SystemExit):
        execute.main(["03_nothing"])
    assert "no notebook 03_nothing.ipynb" in capsys.readouterr().err
    with pytest.raises(ValueError, match="small, full, not 'medium'"):
        execute.execute(notebook_of("1"), "medium", tmp_path)


def test_warnings_and_errors_are_complaints_and_that_something_was_compiled_is_none(tmp_path):
    """The test of every notebook relies on it."""
    once = "elicit: compiling, once on this machine: up to a minute ..."
    over = "elicit: compiled, in 12 s"
    words = (
        f"import sys; print({once!r}, {over!r}, sep='\\n', file=sys.stderr)",
        f"print({once!r}, 'careful', sep='\\n', file=sys.stderr)",
    )
    warns = "import warnings\nwarnings.warn('warned')"
    told = notebook_of("print('fine')", *words, warns, "raise SystemError")
    with pytest.raises(CellExecutionError):
        execute.execute(told, "small", tmp_path)
    *warnings, error = complaints(execute.clean(told, "small"))
    assert ["careful" in complaint.text for complaint in warnings] == [True, False]
    assert "warned" in warnings[1].text
    assert error.ename == "SystemError"


def test_other_code_has_another_hash_but_other_prose_has_not():
    one, two = notebook_of("a = 1", "b = 2"), notebook_of("a = 1", "b = 2")
    two.cells[0].source = "# Another title"
    assert execute.code_hash(one) == execute.code_hash(two)
    two.cells[2].source = "b = 3"
    assert execute.code_hash(one) != execute.code_hash(two)
    assert execute.code_hash(notebook_of("ab", "c")) != execute.code_hash(notebook_of("a", "bc"))


def full_names(source):
    """Return the full names of elicit and qlearn that code uses: imports, and their attributes."""
    tree, known = ast.parse(source), {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            known |= {one.asname or one.name.split(".")[0]: one.name for one in node.names}
        elif isinstance(node, ast.ImportFrom):
            known |= {one.asname or one.name: f"{node.module}.{one.name}" for one in node.names}
    used = {
        *known.values(),
        *(full_name(node, known) for node in ast.walk(tree) if isinstance(node, ast.Attribute)),
    }
    return {name for name in used if name.split(".")[0] in ("elicit", "qlearn")}


def full_name(node, known):
    """Return the full name of a.b.c if a was imported, else nothing."""
    if isinstance(node, ast.Attribute):
        before = full_name(node.value, known)
        return before and f"{before}.{node.attr}"
    return known.get(node.id, "") if isinstance(node, ast.Name) else ""


def not_public(source):
    """Names of elicit and qlearn that the reference does not have; members of what it has are
    public too.
    """
    pages = "\n".join(page.read_text(encoding="utf-8") for page in sorted(REFERENCE.glob("*.md")))
    named = set(re.findall(r"^\.\. (?:auto(?!module)|py:)\w+:: ([\w.]+)", pages, re.MULTILINE))
    modules = {name.rsplit(".", 1)[0] for name in named}
    public = (
        named
        | modules
        | {f"{name}.{member}" for name in named for member in dir(resolve_name(name))}
    )
    return {name for name in full_names(source) if name not in public and name != "qlearn.__file__"}


@each_notebook
def test_it_uses_public_names_only_and_has_no_colours_of_comparators_of_its_own(path):
    source = "\n".join(cell.source for cell in code_cells(execute.read(path)))
    assert full_names(source)
    assert not_public(source) == set()
    assert re.findall(r"(?<=\.)_[a-z]\w*", source) == []
    colours = {style["color"] for style in plot.styles([*plot.STYLES, *"123456"]).values()}
    assert {colour for colour in colours if colour.lower() in source.lower()} <= {"#000000"}


@each_notebook
def test_it_opens_with_question_answer_and_picture_and_the_answers_numbers_are_its_cells(path):
    notebook = execute.read(path)
    opening = notebook.cells[0].source
    assert re.findall(r"^\*\*(\w+)\.\*\*", opening, re.MULTILINE) == [
        "Question",
        "Answer",
        "Picture",
    ]
    _title, *told, picture = opening.split("\n\n")[:5]
    lines = "\n".join(told).splitlines()
    assert len(lines) <= 5
    assert max(map(len, lines)) <= 120
    alt, attached = re.fullmatch(r"!\[(.+)\]\(attachment:(.+)\)", picture).groups()
    assert len(alt) > 40
    drawn = [
        cell for cell in code_cells(notebook) if execute.PICTURE in cell.metadata.get("tags", ())
    ]
    assert len(drawn) == 1
    pictures = [output.get("data", {}).get("image/png") for output in drawn[0].outputs]
    assert notebook.cells[0].attachments[attached]["image/png"] in pictures
    answer = opening.split("**Answer.**")[1].split("**Picture.**")[0]
    answer = re.sub(r"\([^)]* \d{4}\)|`[^`]*`", "", answer)  # but for references and names
    shown = re.sub(r"<[^>]*>", " ", json.dumps(said(notebook)))
    for number, percent in re.findall(NUMBER, answer):
        code = "" if percent or "." in number else "\n".join(c.source for c in code_cells(notebook))
        assert is_there(number, shown + code), number


def test_the_first_one_has_at_most_sixty_lines_of_code():
    """README, its opening and other pages say so."""
    cells = code_cells(execute.read(execute.HERE / "00_your_first_policy.ipynb"))
    lines = [line for cell in cells for line in cell.source.splitlines() if line.strip()]
    assert 50 < len(lines) <= 60


@cache
def configuration():
    """Return what the site's configuration defines."""
    return runpy.run_path(str(REFERENCE.parent / "conf.py"))


@each_notebook
def test_the_site_shows_the_picture_before_any_code_and_says_what_each_picture_shows(path):
    pytest.importorskip("myst_parser")
    page = configuration()["as_markdown"](json.loads(path.read_text(encoding="utf-8")))
    places = [found.start() for found in re.finditer("<p><img ", page)]
    alts = re.findall(r'<p><img alt="([^"]*)" src="data:image/png;base64,', page)
    assert len(alts) == len(places) > 1
    assert places[0] < page.index("```python")
    assert min(map(len, alts)) > 20
    assert "attachment:" not in page


NUMBER = r"(\d+(?:,\d{3})*(?:\.\d+)?)(%?)"


def is_there(number, text):
    """Return whether some number of the text, rounded like this one, is equal to it."""
    digits, value = len(number.partition(".")[2]), float(number.replace(",", ""))
    every = (float(found.replace(",", "")) for found, _ in re.findall(NUMBER, text))
    return any(round(one, digits) == value for one in every)


def test_a_number_that_no_cell_shows_is_noticed():
    assert is_there("7.1", "loses 7.06%")
    assert is_there("2,008", "of 2008 pairs")
    assert not is_there("7.2", "loses 7.06%, not 72")


def test_names_that_are_not_public_are_seen():
    code = (
        "import elicit, qlearn as q\nfrom elicit import plot as p\nfrom elicit.lp import "
        "region\np.STYLES, p._axes\n"
    )
    code += "elicit.Verdict.BETTER, elicit.model, q.drive, q.learners.learner, elicit.Query.make, q.strategies"  # noqa: E501
    found = {
        "elicit.lp.region",
        "elicit.plot._axes",
        "elicit.model",
        "qlearn.learners",
        "qlearn.learners.learner",
    }
    assert not_public(code) == found
