"""The public surface: few parameters each, and names that mean one thing."""

import ast
import inspect
import io
import json
import pkgutil
import re
import tokenize
from collections.abc import Iterator
from dataclasses import is_dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

import elicit
import qlearn
from elicit.asking import elicitation, elicitation_kernel, question
from elicit.model.comparator import ALLOWANCE
from qlearn.learners import query_strategies as strategies
from qlearn.learners.rounds.tuning import TUNING
from tests import syntax
from tests.thoroughness import thorough

MOST = 9  # parameters of one function or class; a common set, such as **asking, counts as one


def public() -> Iterator[tuple[str, Any]]:
    """Every function and class of the two packages without an underscore, and their methods."""
    for package in (elicit, qlearn):
        for found in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            if found.name.endswith("__main__"):
                continue
            try:
                module = import_module(found.name)
            except ModuleNotFoundError:  # an extra that is not installed
                continue
            for name, thing in vars(module).items():
                own = getattr(thing, "__module__", None) == found.name
                if name.startswith("_") or not own or not callable(thing):
                    continue
                yield f"{found.name}.{name}", thing
                for part, method in vars(thing).items() if isinstance(thing, type) else ():
                    method = getattr(method, "__func__", method)
                    if not part.startswith("_") and callable(method):
                        yield f"{found.name}.{name}.{part}", method


def is_record(thing: Any) -> bool:
    """Return whether a thing is a record: the parameters of such are the data that it holds."""
    return is_dataclass(thing) or hasattr(thing, "_fields")


def test_no_function_and_no_class_has_more_parameters_than_one_can_keep_in_mind():
    checked, too_many = 0, {}
    for name, thing in public():
        if is_record(thing):
            continue
        try:
            parameters = inspect.signature(thing).parameters
        except (TypeError, ValueError):  # of a base class written in C
            continue
        checked += 1
        count = len(parameters.keys() - {"self", "cls"})
        if count > MOST:
            too_many[name] = count
    assert checked > 500
    assert not too_many


def test_every_option_of_asking_is_a_keyword_of_every_learner():
    takers = [getattr(qlearn, name) for name in qlearn.__all__ if name.startswith("Interactive")]
    assert len(takers) == 4
    for taker in takers:
        last = list(inspect.signature(taker).parameters.values())[-1]
        assert last.kind is last.VAR_KEYWORD
        assert "AskingOptions" in str(last.annotation)


@pytest.mark.parametrize("name", ["max_querys", "tolerence"])
def test_a_learner_made_with_a_misspelt_keyword_says_which_was_meant(name):
    mdp, _ = qlearn.random_mdp(3, 2, 3, seed=0)
    meant = {"max_querys": "max_queries", "tolerence": "tolerance"}[name]
    with pytest.raises(TypeError, match=f"no keyword '{name}'. The nearest is '{meant}'"):
        qlearn.InteractivePolicyIteration(mdp, elicit.PolytopeComparator(3), **{name: 1})


DOCS = Path(elicit.__file__).parents[1] / "docs"
TOLERANCES = (DOCS / "close-enough.md").read_text(encoding="utf-8")


def found(path: str) -> Any:
    """Return the object that a dotted path names."""
    parts = path.split(".")
    for length in range(len(parts), 0, -1):
        try:
            thing = import_module(".".join(parts[:length]))
        except ModuleNotFoundError:
            continue
        for part in parts[length:]:
            thing = getattr(thing, part)
        return thing
    raise ModuleNotFoundError(path)


@pytest.mark.parametrize(
    ("name", "owner", "default"),
    re.findall(r"^\| `(\w+)` of `([\w.]+)` \| ([^|]+) \|", TOLERANCES, re.MULTILINE),
)
def test_the_page_on_tolerances_has_the_defaults_of_the_code(name, owner, default):
    thing = found(owner)
    if thing is elicit.AskingOptions:
        assert name in thing.__annotations__
        assert default == "derived"
    else:
        assert inspect.signature(thing).parameters[name].default == ast.literal_eval(default)


@pytest.mark.parametrize(
    ("path", "value"),
    re.findall(r"^\| `((?:elicit|qlearn)[\w.]+)` \| ([^|]+) \|", TOLERANCES, re.MULTILINE),
)
def test_the_page_on_tolerances_has_the_constants_of_the_code(path, value):
    assert found(path) == float(value)


def test_the_page_on_tolerances_derives_them_as_the_learners_do():
    mdp, _ = qlearn.random_mdp(3, 2, 3, discount=0.9, seed=0)
    known = elicit.PolytopeComparator(3)

    def indifference(asker: Any) -> float:
        return asker._elicitation.indifference

    policy_iteration = qlearn.InteractivePolicyIteration(mdp, known, tolerance=0.1, max_loss=0.2)
    assert indifference(policy_iteration) == pytest.approx(0.2 * (1 - 0.9))
    value_iteration = qlearn.InteractiveValueIteration(mdp, known, tolerance=0.1)
    assert indifference(value_iteration) == pytest.approx(0.1 * (1 - 0.9) / 2)
    assert value_iteration._small_span == pytest.approx(0.1 * (1 - 0.9) / (2 * 0.9))
    training = qlearn.InteractiveTraining(known, discount=0.9, tolerance=0.1)
    assert indifference(training) == pytest.approx(0.1 / 2)
    assert indifference(qlearn.InteractiveQLearning(mdp, known, steps=1)) == 0
    assert len(re.findall(r"^\| `(\w+)` of `", TOLERANCES, re.MULTILINE)) == 10
    assert (TUNING.matters, TUNING.error, TUNING.close) == (0.5, 0.02, 0.3)
    assert ALLOWANCE == 2


def classes() -> Iterator[tuple[str, str]]:
    """The name of every class of the two packages, without underscores, and where it is."""
    for package in (elicit, qlearn):
        for path in sorted(Path(package.__file__ or "").parent.rglob("*.py")):
            for name, line in syntax.classes(path):
                yield name.lstrip("_"), f"{path.name}:{line}"


def test_no_two_classes_share_a_name():
    places: dict[str, list[str]] = {}
    for name, place in classes():
        places.setdefault(name, []).append(place)
    assert len(places) > 100
    assert not {name: where for name, where in places.items() if len(where) > 1}


def test_the_glossary_has_a_sentence_for_each_word_and_names_that_are_in_the_code():
    text = (DOCS / "glossary.md").read_text(encoding="utf-8")
    pattern = re.compile(r"^- \*\*([^*]+)\*\*(.*?)(?=\n- |\n\n)", re.MULTILINE | re.DOTALL)
    sections = [pattern.findall(section) for section in text.split("\n## ")]
    for section in sections:
        words = [word for word, _ in section]
        assert words == sorted(words, key=str.lower)
    entries = [entry for section in sections for entry in section]
    assert len({word for word, _ in entries}) == len(entries) > 50
    for word, sentence in entries:
        assert sentence.endswith("."), word
        assert not re.search(r"\. [A-Z]", sentence), word
    modules = (elicitation, elicitation_kernel, question, strategies)
    known = {name for name, _ in classes()} | {name for one in modules for name in vars(one)}
    named = {name for _, rest in entries for name in re.findall(r"^ \(`([A-Z]\w+)`\)", rest)}
    assert len(named) > 15
    assert not named - known
    assert "glossary" in (DOCS / "index.md").read_text(encoding="utf-8")


# a sentence that begins so has no subject, or is half a question
BAD_BEGINNING = re.compile(
    r"(What|Of|With|Whether|Where|How|Those|The same|So|As|Which|Whom|Who|When|None|Not|All that"
    r"|Among)\b"
)
BAD_STRING = re.compile(rf"[\"'](\\?\s)*{BAD_BEGINNING.pattern}")


def test_docstrings_begin_with_a_verb_or_a_noun():
    root, checked, bad = DOCS.parent, 0, []
    for package in ("elicit", "qlearn", "benchmarks", "examples", "tests"):
        for path in sorted((root / package).rglob("*.py")):
            place = path.relative_to(root).as_posix()
            whole = path.read_text(encoding="utf-8")
            if not (thorough() or BAD_STRING.search(whole)):
                checked += whole.count('"""') // 2  # without the time to parse it
                continue
            for node in syntax.statements(syntax.parsed(path)):
                kinds = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef, ast.Module)
                text = ast.get_docstring(node) if isinstance(node, kinds) else None
                checked += text is not None
                if text and BAD_BEGINNING.match(text):
                    bad.append((place, text.splitlines()[0]))
    assert checked > 3000
    assert not bad


PRIVATE = re.compile(
    r"\b(she|her|hers|herself|he|him|his|himself|foretells?|certif(y|ies) first)\b", re.I
)
PRIVATE_IN_PROSE = re.compile(  # these are also names in code, or mean something else elsewhere
    r"\bslip(s|ped|ping)?\b(?! aside| : )|(?<!south-east )\bcorners?\b|\bwhoever answers\b"
    r"|\bjudg(e|es|ed|ing)\b|\bsettl\w+ (\w+ )?(comparison|pair)s?\b"
    r"|\bbounds? (is|was|were) broken\b"
    r"|\b(keeps?|kept|breaks?|broke|broken) (a|its|their|this|the stated) bounds?\b"
    r"|\bturned round\b|\bway round\b|\b(hang|rest)(s|ing)? on\b|\bnot told of\b|\btold from\b"
    r"|\bsurely (fewer|more|less)\b|\bat the door\b|\bdearly\b",
    re.I,
)
MADE = {"about-equal.md", "assumptions.md", "claims.md", "exploration.md", "literal.md"}


def read(path):
    """Return the text of a file, of a notebook only the cells of text."""
    text = path.read_text(encoding="utf-8")
    if path.suffix != ".ipynb":
        return text
    cells = json.loads(text)["cells"]
    return "\n\n".join("".join(c["source"]) for c in cells if c["cell_type"] == "markdown")


def prose(path, text):
    """Return the text of a page without its code, or the docstrings and comments of a module."""
    if path.suffix != ".py":
        text = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    else:
        kinds = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
        nodes = (node for node in ast.walk(ast.parse(text)) if isinstance(node, kinds))
        tokens = tokenize.generate_tokens(io.StringIO(text).readline)
        comments = (token.string for token in tokens if token.type == tokenize.COMMENT)
        text = "\n".join([*(ast.get_docstring(node) or "" for node in nodes), *comments])
    return re.sub(r"``[^`]*``|`[^`]*`", "", text)


def test_the_docs_and_the_code_use_the_words_of_the_glossary():
    """All but pages that commands make, and names of their rows."""
    root, found = DOCS.parent, []
    pages = [*DOCS.rglob("*.md"), root / "README.md", root / "CONTRIBUTING.md"]
    notebooks = [*(root / "notebooks").glob("*.ipynb")]
    code = [*(root / "elicit").rglob("*.py"), *(root / "qlearn").rglob("*.py")]
    for path in [*pages, *notebooks, *code]:
        place = path.relative_to(root).as_posix()
        made = path.name in MADE or path.name == "glossary.md"
        if made:
            continue
        text = re.sub(r"<!--.*?-->", "", read(path), flags=re.DOTALL)
        found += [(place, match[0]) for match in PRIVATE.finditer(text)]
        found += [(place, match[0]) for match in PRIVATE_IN_PROSE.finditer(prose(path, text))]
    assert len(pages) > 15
    assert len(notebooks) > 10
    assert not found
