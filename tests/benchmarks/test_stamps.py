"""A page says how it was made, and of which sources: what counts among them, and what does not."""

import ast
import json
import sys
from pathlib import Path

import pytest

from benchmarks import evidence, stamps
from benchmarks.evidence import Page
from benchmarks.stamps import Stamp

NOW = Stamp("python -m benchmarks.x --out x.md", "0-19", "2026-01-31", "0123456789")
BEFORE = Stamp("python -m benchmarks.x")


@pytest.mark.parametrize("stamp", [NOW, BEFORE])
@pytest.mark.parametrize("name", ["x.md", "x.csv"])
def test_a_page_has_one_stamp_which_is_read_back_and_taken_off(tmp_path, name, stamp):
    page = tmp_path / name
    page.write_text("# Title\n\n| a |\n")
    assert stamps.of(page) is None
    stamps.put(page, NOW._replace(day="2025-01-01"))
    stamps.put(page, stamp)
    assert stamps.of(page) == stamp
    assert stamps.without(page.read_text()) == "# Title\n\n| a |\n"


def test_the_stamp_of_a_notebook_is_in_its_metadata(tmp_path):
    page = tmp_path / "x.ipynb"
    page.write_text(json.dumps({"cells": [], "metadata": {"executed": {"stamp": str(NOW)}}}))
    assert stamps.of(page) == NOW
    page.write_text(json.dumps({"cells": [str(NOW)], "metadata": {}}))
    assert stamps.of(page) is None


def test_what_is_written_in_a_test_is_not_stamped(tmp_path):
    page = tmp_path / "x.md"
    page.write_text("text\n")
    stamps.sign(page, "0")
    assert page.read_text() == "text\n"


@pytest.fixture
def project(tmp_path, monkeypatch):
    """A program of benchmarks that imports what imports something else, within a function."""
    monkeypatch.setattr(stamps, "ROOT", tmp_path)
    files = {
        "benchmarks/program.py": '"""What it is."""\n\ndef main():\n    from elicit.near import '
        "one\n    return one\n",
        "elicit/near.py": "import numpy\nimport elicit.far\n\none = elicit.far.two  # that\n",
        "elicit/far.py": "two = 2\n",
        "elicit/other.py": "three = 3\n",
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


def changed(path: Path, old: str, new: str) -> str:
    """The hash of the program's sources with another text in one of them."""
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    stamps._module.cache_clear()  # which goes by the time of change, and that has its grain
    return stamps.sources("benchmarks.program")


def test_code_counts_wherever_it_is_imported_from_and_words_do_not(project):
    first = stamps.sources("benchmarks.program")
    assert changed(project / "elicit/other.py", "3", "4") == first
    assert changed(project / "elicit/near.py", "# that", "# this") == first
    assert changed(project / "benchmarks/program.py", "What it is", "Said better") == first
    further = changed(project / "elicit/far.py", "2", "3")
    assert further != first
    assert changed(project / "benchmarks/program.py", "return one", "return one + 1") not in (
        first,
        further,
    )
    assert changed(project / "elicit/far.py", "3", "2") != first


def test_a_docstring_is_no_code_but_a_string_is():
    said, unsaid = (
        stamps._told(ast.parse(f"def f(x=1):\n    {text}return 'a'\n"))
        for text in ("'Says.'\n    ", "")
    )
    assert said == unsaid
    assert "'a'" in said
    assert stamps._told(ast.parse("f(x=0)")) != stamps._told(ast.parse("f(x=1)"))


def test_a_lazy_name_leads_to_its_module_and_only_to_that():
    tree = ast.parse(
        "import elicit\nimport qlearn\nelicit.PolytopeComparator(3), qlearn.strategies.max_regret"
    )
    assert set(stamps._imported(tree)) == {
        "elicit.comparators.polytope.comparator",
        "qlearn.learners.query_strategies",
    }
    tree = ast.parse(
        "from elicit import Answer, plot\nfrom qlearn import drive\nfrom benchmarks.training "
        "import terrain"
    )
    assert set(stamps._imported(tree)) == {
        "elicit.model.query",
        "elicit.plot",
        "qlearn.learners.learner",
        "benchmarks.training.terrain",
    }


def test_what_only_compiles_is_of_no_number(monkeypatch):
    met = []
    read = stamps._module
    monkeypatch.setattr(
        stamps, "_module", lambda name, changed: met.append(name) or read(name, changed)
    )
    stamps.sources("qlearn")  # figures, whose catalogue knows all learners
    assert {
        "qlearn.experiments.catalogue",
        "qlearn.learners.q_learning",
        "qlearn.learners.policy_iteration",
    } <= {*met}
    assert "qlearn.experiments.compile_ahead" not in met
    met.clear()
    stamps.sources("benchmarks.asking.certificates")
    assert "qlearn.learners.policy_iteration" in met


def test_what_reads_the_runs_is_of_no_number_in_them(monkeypatch):
    met = []
    read = stamps._module
    monkeypatch.setattr(
        stamps, "_module", lambda name, changed: met.append(name) or read(name, changed)
    )
    (table,) = (
        page for page in evidence.PAGES if page.copy_of
    )  # which is what is kept of `qlearn figures`
    assert table.sources
    assert "qlearn.paper.figure_runs" in met
    assert not {*stamps.AFTERWARDS["qlearn"]} & {*met}
    met.clear()
    stamps.sources("qlearn.paper.figure_runs")  # what makes the runs has no use for these
    assert not {*stamps.AFTERWARDS["qlearn"]} & {*met}
    stamps.sources("benchmarks.paper.figure_pages")
    assert "qlearn.paper.claims" in met


def test_a_notebook_is_of_its_cells_and_of_the_tables_that_it_reads(tmp_path, monkeypatch):
    monkeypatch.setattr(stamps, "ROOT", tmp_path)
    page, data = tmp_path / "notebooks" / "x.ipynb", tmp_path / "notebooks" / "data"
    data.mkdir(parents=True)

    def of(code: str, words: str = "", read: str = "1", unread: str = "1") -> str:
        cells = [
            {"cell_type": "markdown", "source": [words]},
            {"cell_type": "code", "source": [code]},
        ]
        page.write_text(json.dumps({"cells": cells, "metadata": {}}))
        (data / "read.csv").write_text(read)
        (data / "unread.csv").write_text(unread)
        return stamps.sources("notebooks/x.ipynb")

    first = of("open('read.csv')")
    assert of("open('read.csv')  # a table", "Words", unread="2") == first
    assert len({first, of("open('read.csv')", read="2"), of("open('read.csv', 'rb')")}) == 3


@pytest.fixture
def pages(tmp_path, monkeypatch):
    """Two pages, the second of a program that fails, which a stand-in for their programs writes."""
    monkeypatch.setattr(evidence, "ROOT", tmp_path)
    monkeypatch.setattr(Page, "sources", property(lambda page: "0123456789"))
    found = (
        Page("a.md", "program a", 1),
        Page("b.md", "program b", 1),
        Page("c.md", "program c", 1, ("peers",)),
    )
    monkeypatch.setattr(evidence, "PAGES", found)
    ran = []

    def run(command, cwd):
        ran.append(command[-1])
        if command[-1] == "a":
            (tmp_path / "a.md").write_text(f"{NOW}\n")
        return evidence.subprocess.CompletedProcess(command, int(command[-1] == "b"))

    monkeypatch.setattr(evidence.subprocess, "run", run)
    monkeypatch.setattr(evidence.stamps, "sources", lambda program: "0123456789")
    monkeypatch.setattr(evidence, "find_spec", lambda name: None)
    return ran


def test_what_is_stale_is_made_again_and_what_fails_or_cannot_be_is_said(pages, capsys):
    assert evidence.main(["--all"]) == 1
    assert pages == ["a", "b"]
    told = capsys.readouterr()
    assert "c.md needs pip install -e '.[peers]'" in told.err
    assert "left as they were: b.md, c.md" in told.err
    assert evidence.main(["--only", "a"]) == 0  # as it is current now
    assert evidence.main(["--stale"]) == 1
    assert pages == ["a", "b"]
    told = capsys.readouterr().out
    assert "a.md is current" in told
    assert [line.split()[0] for line in told.splitlines()[1:]] == ["b.md", "c.md"]
    assert evidence.main(["--only", "a", "--fresh"]) == 0
    assert pages == ["a", "b", "a"]


@pytest.mark.parametrize("options", [[], ["--list"], ["--only", "a", "--list"]])
def test_hours_of_work_are_not_begun_unless_that_is_said(options, pages, capsys):
    assert evidence.main(options) == 0
    told = capsys.readouterr().out
    assert "a: not stamped; 1 min: python -m program a\n" in told
    assert f"--all makes the {1 if 'a' in options else 3} that are stale again, in about" in told
    with pytest.raises(SystemExit):
        evidence.main(["--fresh"])
    assert "--fresh goes with --all, or with --only" in capsys.readouterr().err
    assert not pages


def test_a_copy_is_stamped_with_the_sources_of_when_it_was_begun(tmp_path, monkeypatch):
    monkeypatch.setattr(evidence, "ROOT", tmp_path)
    page = Page("copy.md", "program", 1, (), "out.md", "0-3")
    hashes = iter(["at first", "afterwards"])
    monkeypatch.setattr(evidence.stamps, "sources", lambda program: next(hashes))

    def run(command, cwd):
        assert command == [sys.executable, "-m", "program"]
        (tmp_path / "out.md").write_text("text\n")
        return evidence.subprocess.CompletedProcess(command, 0)

    monkeypatch.setattr(evidence.subprocess, "run", run)
    assert not evidence.make(page)
    text = (tmp_path / "copy.md").read_text()
    assert "text" in text
    assert "by `python -m program`; seeds 0-3; sources at first." in text
