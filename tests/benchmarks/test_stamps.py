"""A page says how it was made, and of which sources: what counts among them, and what does not."""

import ast
import json
import sys
from pathlib import Path

import pytest

import elicit
import qlearn
from benchmarks import evidence, rows_again, stamps
from benchmarks.evidence import PAGES, ROOT, Page
from benchmarks.rows_again import Sample
from benchmarks.stamps import Stamp
from tests.syntax import parsed

NOW = Stamp("python -m benchmarks.x --out x.md", "0-19", "2026-01-31", "0123456789")
BEFORE = Stamp("python -m benchmarks.x")
AGAIN = NOW._replace(again="2026-02-28", again_by="9876543210")


@pytest.mark.parametrize("stamp", [NOW, BEFORE, AGAIN])
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
    """A program in a folder of benchmarks, beside the code that it may run."""
    monkeypatch.setattr(stamps, "ROOT", tmp_path)
    files = {
        "benchmarks/asking/program.py": '"""What it is."""\n\n'
        "from benchmarks.learning import helper\nfrom benchmarks.page import put\n\n"
        "def main():\n    return 1\n",
        "benchmarks/asking/beside.py": "seven = 7\n",
        "benchmarks/page.py": "eight = 8\n",
        "benchmarks/learning/__init__.py": "nine = 9\n",
        "benchmarks/learning/helper.py": "import benchmarks.learning.further\n\none = 1\n",
        "benchmarks/learning/further.py": "ten = 10\n",
        "benchmarks/pages.toml": '[[page]]\npath = "x.md"\nminutes = 1\n'
        'command = "benchmarks.asking.program --out x.md"\nsources = []\n',
        "elicit/near.py": "two = 2  # that\n",
        "qlearn/mdp/far.py": "three = 3\n",
        "benchmarks/fitting/other.py": "four = 4\n",
        "elicit/person/screen.py": "five = 5\n",
        "elicit/testing/checks.py": "six = 6\n",
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True, parents=True)
        (tmp_path / name).write_text(text)
    return tmp_path


def changed(path: Path, old: str, new: str) -> str:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    stamps._code_of.cache_clear()  # a file system may count time in whole milliseconds
    found = stamps.sources("benchmarks.asking.program")
    path.write_text(text)
    stamps._code_of.cache_clear()
    return found


def test_the_code_of_a_program_is_its_own_what_it_imports_and_what_the_manifest_names(project):
    first = stamps.sources("benchmarks.asking.program")
    counts = {
        "elicit/near.py": "2",
        "qlearn/mdp/far.py": "3",
        "benchmarks/asking/program.py": "1",
        "benchmarks/learning/__init__.py": "9",
        "benchmarks/learning/helper.py": "1",
        "benchmarks/learning/further.py": "10",
    }
    assert first not in {changed(project / name, old, "7") for name, old in counts.items()}
    assert changed(project / "benchmarks/fitting/other.py", "4", "7") == first
    assert changed(project / "benchmarks/asking/beside.py", "7", "8") == first
    assert changed(project / "benchmarks/page.py", "8", "7") == first
    assert changed(project / "benchmarks/asking/program.py", "What it is", "Words") == first
    assert changed(project / "elicit/near.py", "# that", "# this") == first
    assert changed(project / "elicit/person/screen.py", "5", "7") == first
    assert changed(project / "elicit/testing/checks.py", "6", "7") == first
    named = project / "benchmarks" / "pages.toml"
    named.write_text(named.read_text().replace("[]", '["elicit/person"]'))
    first = stamps.sources("benchmarks.asking.program")
    assert changed(project / "elicit/person/screen.py", "5", "7") != first
    (project / "elicit" / "new.py").write_text("")
    assert stamps.sources("benchmarks.asking.program") != first


RAISED = "if x < 0:\n    raise ValueError(f'{x}' 'at')\nwarn('w')\ny = 'a'"
CHECKED = "require(x > 0, 'x', 'above 0', x)\nclass Status:\n    DONE = 'done'"


@pytest.mark.parametrize(
    ("code", "changed_code", "counts"),
    [
        (RAISED, "if x < 0:\n    raise ValueError(f'less than {x}')\nwarn(f'{x}')\ny = 'a'", False),
        (
            RAISED,
            "if x < 0:\n    raise ValueError('a' + ('b' if x else str(x)))\nwarn('w')\ny = 'a'",
            False,
        ),
        (RAISED, "if x < 1:\n    raise ValueError('at')\nwarn('w')\ny = 'a'", True),
        (RAISED, "if x < 0:\n    raise TypeError('at')\nwarn('w')\ny = 'a'", True),
        (RAISED, "if x < 0:\n    raise ValueError('at', x)\nwarn('w')\ny = 'a'", True),
        (RAISED, "if x < 0:\n    raise ValueError('at')\nwarn('w')\ny = 'b'", True),
        (CHECKED, "require(x > 0, 'x', 'positive', x)\nclass Status:\n    DONE = 'end'", False),
        (CHECKED, "require(x > 1, 'x', 'above 0', x)\nclass Status:\n    DONE = 'done'", True),
        (CHECKED, "require(x > 0, 'x', 'above 0', x)\nclass Status:\n    ENDED = 'done'", True),
        (CHECKED, "require(x > 0, 'x', 'above 0', x)\nclass Other:\n    DONE = 'done'", True),
        ("checks.reject('x', x, bad, 'too low')", "checks.reject('x', x, bad, 'low')", False),
        ("np.require(x, requirements=['C'])", "np.require(x, requirements=['F'])", True),
        ("steps = setting(9, COUNT, 'number')", "steps = setting(9, COUNT, 'how many')", False),
        ("steps = setting(9, COUNT, 'number')", "steps = setting(8, COUNT, 'number')", True),
        ("steps = setting(9, COUNT, 'number')", "steps = setting('flip', COUNT, 'number')", True),
    ],
)
def test_the_text_of_errors_warnings_statuses_and_help_does_not_count(
    project, code, changed_code, counts
):
    near = project / "elicit/near.py"
    near.write_text(code)
    first = stamps.sources("benchmarks.asking.program")
    assert (changed(near, code, changed_code) != first) is counts


def test_every_source_of_the_manifest_is_there():
    named = {source for page in PAGES for source in page.sources}
    assert named
    assert all((ROOT / source).exists() for source in named)


def test_no_number_comes_from_code_that_is_set_aside():
    """But in a program whose page names that code in the manifest."""
    aside = [each.removesuffix(".py").replace("/", ".") for each in stamps.ASIDE]
    assert all((ROOT / each).exists() for each in stamps.ASIDE)

    def is_aside(module: str) -> bool:
        return any(f"{module}.".startswith(f"{each}.") for each in aside)

    found = set()
    for folder in ("elicit", "qlearn", "benchmarks"):
        for file in sorted((ROOT / folder).rglob("*.py")):
            name = file.relative_to(ROOT).with_suffix("").as_posix().replace("/", ".")
            if file.name != "__init__.py" and not is_aside(name):
                found |= {name for module in imported(file) if is_aside(module)}
    assert found == {
        "benchmarks.asking.person_sessions",  # the manifest names it
        "benchmarks.quotes",  # writes the help of commands into the docs
        "benchmarks.shown_ranges",  # the manifest names it
        "qlearn.__main__",
    }


def imported(file: Path) -> set[str]:
    """The modules that a file imports, be it by a public name of elicit or qlearn."""
    found = {*stamps._imports_of(file.relative_to(ROOT).as_posix(), 0)}
    for node in ast.walk(parsed(file)):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            found.add(f"{node.value.id}.{node.attr}")
    public = {
        f"{package.__name__}.{name}": module
        for package in (elicit, qlearn)
        for name, module in (package._LATER | package._MODULES).items()
    }
    return found | {public[name] for name in found & {*public}}


def test_a_notebook_is_of_its_cells_and_of_the_tables_that_it_reads(tmp_path, monkeypatch):
    monkeypatch.setattr(stamps, "ROOT", tmp_path)
    page, data = tmp_path / "notebooks" / "x.ipynb", tmp_path / "notebooks" / "data"
    data.mkdir(parents=True)
    monkeypatch.setattr(stamps, "EVERYWHERE", ())

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
    assert [line.split(":")[0] for line in told.splitlines()[1:-1]] == ["b", "c"]
    assert evidence.main(["--only", "a", "--fresh"]) == 0
    assert pages == ["a", "b", "a"]


def test_a_page_whose_rows_are_the_same_is_stamped_so_and_is_not_stale(
    tmp_path, monkeypatch, capsys
):
    page = Page("a.md", "program a", 1)
    monkeypatch.setattr(evidence, "ROOT", tmp_path)
    monkeypatch.setattr(evidence, "PAGES", (page, page._replace(path="b.md", times=True)))
    for name in ("a.md", "b.md"):
        (tmp_path / name).write_text(f"| a | 1.0 |\n\n{NOW}\n")
    monkeypatch.setattr(evidence.stamps, "sources", lambda program: "0f0f")
    monkeypatch.setattr(rows_again, "ROOT", tmp_path)
    rows = [["a", "1.1"]]
    samples = [Sample(name, lambda text: iter(rows)) for name in "ab"]
    monkeypatch.setattr(rows_again, "SAMPLES", samples)
    assert evidence.main(["--repeat"]) == 1  # the row differs
    assert page.state == "of older sources"
    assert "a.md has no such row: ['a', '1.1']" in capsys.readouterr().out
    rows[0][1] = "1.0"
    assert evidence.main(["--repeat"]) == 1  # b.md shows times
    told = capsys.readouterr()
    assert "a.md: rows made again are the same" in told.out
    assert "b.md is to be made again whole: it shows times" in told.out
    assert "left as they were: b.md" in told.err
    assert page.state == "repeated"
    assert (tmp_path / "a.md").read_text().startswith("| a | 1.0 |\n\nMade on 2026-01-31 by ")
    assert not page.stale
    monkeypatch.setattr(evidence.stamps, "sources", lambda program: "1f1f")
    assert page.stale


@pytest.mark.parametrize("options", [[], ["--stale", "--only", "a"]])
def test_hours_of_work_are_not_begun_unless_that_is_said(options, pages, capsys):
    assert evidence.main(options) == bool(options)
    told = capsys.readouterr().out
    assert "a: not stamped; 1 min: python -m program a\n" in told
    assert f"--all makes the {1 if 'a' in options else 3} that are stale again, in about" in told
    with pytest.raises(SystemExit):
        evidence.main(["--fresh"])
    assert "--fresh goes with --all, or with --only" in capsys.readouterr().err
    assert not pages


def test_a_copy_is_stamped_with_the_sources_of_when_it_was_begun(tmp_path, monkeypatch):
    monkeypatch.setattr(evidence, "ROOT", tmp_path)
    page = Page("copy.md", "program", 1, copy_of="out.md", seeds="0-3")
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
