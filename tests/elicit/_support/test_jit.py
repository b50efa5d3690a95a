"""Compiled or not, the same numbers to the last bit; and the machine code on disk is that of
today's sources.
"""

import hashlib
import json
import re
from pathlib import Path

import numpy as np
import pytest

from elicit import Answers, BradleyTerryTutor, FlippingTutor, PolytopeComparator, decide
from elicit._support import jit
from qlearn.mdp.backup import back_up_all
from tests.interpreter import report_of, run
from tests.lp_cases import cases
from tests.thoroughness import thorough


def report() -> list[str]:
    """One line a case: its kind, verdicts, tiers, and a hash of bounds and values, to the last
    bit.
    """
    lines = []
    for i, case in enumerate(cases(97, 32, asks=10, most_levels=10, most_answers=40)):
        comparator = PolytopeComparator(case.k, case.margin, case.prior)
        verdicts, tiers, digest = [], [], hashlib.blake2b(digest_size=8)
        for rows in np.array_split(np.arange(len(case.y)), 1 + i % 4):
            comparator = comparator.update(Answers(case.d[rows], case.y[rows]))
            decided = decide(comparator, case.ask)
            verdicts += decided.verdicts.tolist()
            tiers += decided.tiers.tolist()
            for numbers in (*comparator.bounds(case.ask), comparator.values):
                digest.update(numbers.tobytes())
        lines.append(f"{case.kind} {verdicts} {tiers} {digest.hexdigest()}")
    d = np.repeat(np.random.default_rng(0).normal(size=(40, 4)), 3, axis=0)
    for tutor in (FlippingTutor([0, 1, 3, 4], 0.3, 7), BradleyTerryTutor([0, 1, 3, 4], 2.0, 7)):
        lines.append(f"tutor {tutor.signs(d).tolist()} [] {tutor.realised_error_rate}")
    return lines


@pytest.mark.slow
def test_compiled_and_interpreted() -> None:
    ours = report()
    assert len({line.split()[0] for line in ours}) > 10
    assert {
        tier for line in ours for tier in line.split("] [")[1].split("]")[0].split(", ")
    } >= set("012345")
    assert report_of(__name__) == ours


def test_numba_is_imported_only_when_a_comparator_needs_it() -> None:
    code = (
        "import sys, elicit; print('numba' in sys.modules); elicit.PolytopeComparator; "
        "print('numba' in sys.modules)"
    )
    assert run(code) == ["False", "True"]


PATIENT = {"ELICIT_COMPILE_FIRST": ""}
WATCH = """
from elicit._support import jit  # first: it breaks off what is not to be compiled before others are told
from numba.core import event
class Watch(event.Listener):
    seen = []
    def on_start(self, event): self.seen.append(event.data["dispatcher"].py_func.__name__)
    def on_end(self, event): pass
event.register("numba:compile", Watch())
"""  # noqa: E501


HELPER = "from elicit._support.jit import compiled\n@compiled\ndef helper(x):\n    return x + {}\n"
CALLER = """from elicit._support.jit import compiled
from helper import helper
@compiled
def caller(x):
    return 2 * helper(x)
"""


@pytest.mark.slow
def test_a_change_in_another_file_is_seen(tmp_path: Path) -> None:
    """numba keeps ``caller`` as it was compiled while its own file stays the same."""
    (tmp_path / "caller.py").write_text(CALLER)
    code = "from caller import caller; print(caller(1))"
    for summand, result in ((1, "4"), (10, "22"), (1, "4")):
        (tmp_path / "helper.py").write_text(HELPER.format(summand))
        assert run(
            code, tmp_path, NUMBA_CACHE_DIR=str(tmp_path / "kept"), PYTHONDONTWRITEBYTECODE="1"
        ) == [result]
    assert len({path.parent for path in (tmp_path / "kept").rglob("caller*.nbi")}) == 2


@pytest.mark.slow
def test_what_else_was_imported_before_makes_no_difference_to_where_ours_is_kept(
    tmp_path: Path,
) -> None:
    (tmp_path / "helper.py").write_text(HELPER.format(1))
    code = (
        "from elicit._support.hashing import mix; import numpy as np; mix(np.uint64(1), "
        "np.uint64(2))"
    )
    run(code, tmp_path, NUMBA_CACHE_DIR=str(tmp_path / "kept"))
    kept = set((tmp_path / "kept").rglob("*.nbi"))
    run("import helper; " + code, tmp_path, NUMBA_CACHE_DIR=str(tmp_path / "kept"))
    assert len(kept) >= 1
    assert set((tmp_path / "kept").rglob("*.nbi")) == kept


def test_where_qlearn_is_kept_depends_on_no_other_package(tmp_path: Path) -> None:
    (tmp_path / "helper.py").write_text(HELPER.format(1))
    code = "from qlearn.mdp.backup import back_up_all; print(back_up_all._place)"
    with_helper = run("import helper; " + code, tmp_path)
    assert with_helper == [str(back_up_all._place)]  # here, tests are such packages too


def test_a_place_for_each_state_of_the_sources(tmp_path: Path) -> None:
    def place(usual: str, folder: Path) -> str:
        return jit._cache_of.__wrapped__(usual, folder, frozenset({tmp_path}))

    (tmp_path / "one.py").write_text("from elicit._support.jit import compiled\n")
    (tmp_path / "room").mkdir()
    before = place("", tmp_path)
    assert Path(before).parent == tmp_path / "__pycache__"
    assert Path(place("/elsewhere", tmp_path)).parent == Path("/elsewhere")
    (tmp_path / "two.py").write_text("nothing is made of this")
    assert place("", tmp_path) == before
    (tmp_path / "room" / "two.py").write_text("from elicit._support.jit import compiled\n")
    assert place("", tmp_path) != before
    (tmp_path / "room" / "two.py").unlink()
    assert place("", tmp_path) == before


def test_the_first_call_on_a_machine_says_what_it_waits_for_and_that_it_is_over(
    tmp_path: Path,
) -> None:
    """Neither other functions nor other processes say it again; and numba's settings stay as they
    were.
    """
    (tmp_path / "helper.py").write_text(HELPER.format(1))
    kept = str(tmp_path / "kept")
    code = (
        "import sys, numba, helper; sys.stderr = sys.stdout; helper.helper(1); helper.helper(1.5)"
    )
    show = "; print(numba.config.CACHE_DIR)"
    began, settings, ended = run(code + show, tmp_path, NUMBA_CACHE_DIR=kept)
    assert began.startswith("elicit: compiling, once on this machine")
    assert settings == kept
    assert re.fullmatch(r"elicit: compiled, in \d+ s", ended)
    if not thorough():  # that another process says nothing, a test below sees too
        return
    assert run(code + "; helper.helper(1j)", tmp_path, NUMBA_CACHE_DIR=kept) == []


@pytest.mark.slow
def test_that_it_is_over_is_said_while_the_process_goes_on(tmp_path: Path) -> None:
    (tmp_path / "helper.py").write_text(HELPER.format(1))
    code = """
import sys, time
from elicit._support import jit
from helper import helper
sys.stderr = sys.stdout
jit._Announcer._QUIET = 0.2
helper(1)
time.sleep(1.0)
print("later")
"""
    began, ended, later = run(code, tmp_path, NUMBA_CACHE_DIR=str(tmp_path / "kept"))
    assert (began.split(",")[0], ended.split(",")[0], later) == (
        "elicit: compiling",
        "elicit: compiled",
        "later",
    )


@pytest.mark.slow
def test_of_processes_that_compile_beside_each_other_one_says_so(tmp_path: Path) -> None:
    code = "from elicit._support.jit import first_on_this_machine as first; print(first(), first())"
    both = [run(code, NUMBA_CACHE_DIR=str(tmp_path)) for _ in range(2)]
    assert both == [["True False"], ["False False"]]
    (tmp_path / "file").write_text("where no folder can be made")
    assert run(code, NUMBA_CACHE_DIR=str(tmp_path / "file")) == [
        "True True"
    ]  # it is compiled each time, too


@pytest.mark.slow
def test_where_nothing_can_be_written_it_works_all_the_same() -> None:
    """A read-only installation, and no home."""
    code = """if True:
        import numba.core.caching as caching
        def refuse(self): raise OSError("read-only file system")
        for kind in vars(caching).values():
            if isinstance(kind, type) and hasattr(kind, "ensure_cache_path"):
                kind.ensure_cache_path = refuse
        from elicit._support.jit import compiled
        def half(x): return x / 2
        print(compiled(half)(4.0))
    """
    assert run(code) == ["2.0"]


STRANGE = """import math
import numpy as np
from elicit._support.jit import compiled
@compiled
def strange(x, i, h):
    out = np.empty(12)
    out[0], out[1], out[2] = math.log(x[0]), math.log(-x[1]), math.sqrt(-x[1])
    out[3], out[4], out[5] = math.exp(1e3 * x[1]), math.ldexp(x[1], 5000), math.expm1(1e3 * x[1])
    out[6], out[7], out[8] = x[1] / x[0], -x[1] / x[0], x[0] / x[0]
    out[9], out[10] = i[0] // i[1], i[0] % i[1]
    out[11] = x[2] * x[3] + x[4]
    return out, h * h + h, x[1] > x[0], x[1]
"""


NUMBERS = """
import numpy as np
from strange_numbers import strange
x = np.array([0.0, 1.0, 1.0 + 2.0**-30, 1.0 - 2.0**-30, -1.0])
out, *rest = strange(x, np.array([-7, 3]), np.uint64(2**63 + 3))
print(np.where(np.isnan(out), 7.0, out).tobytes().hex(), rest, [type(each).__name__ for each in rest])
"""  # noqa: E501
NUMBERS_IN_A_CALL = CALLER.replace("2 * helper(x)", "helper(x) + helper(1) + helper(-2)")
WRITTEN_OUT = """from elicit._support.jit import compiled, written_out
@written_out
def part(x, i):
    grown = x * 1.1 + i
    return grown, i % 3
@compiled
def loop(n):
    total, x = 0.0, 0.5
    for i in range(n):
        x, rest = part(x, i)
        total += x - rest
    return total
"""
PROGRAMS: dict[str, tuple[dict[str, str], str]] = {  # each has modules of its own
    "until it has taken long": (
        {"helper": HELPER.format(1), "caller": CALLER},
        """
from caller import caller
clock = iter([0.0, 0.1, 0.2, 1000.0])
jit.thread_time = lambda: next(clock)
print(caller(1), caller(2), sorted(Watch.seen))
print(caller(3), sorted(Watch.seen))
""",
    ),
    "in parts": (
        {
            "helper": HELPER.format(1),
            "caller": CALLER.replace("compiled", "compiled_in_parts"),
            "other": CALLER,
        },
        """
import other
from caller import caller, helper
clock = iter([0.0, 0.1, 0.2, 1000.0])
print(caller(1), Watch.seen)
jit.expect(caller, 1000.0)
jit.expect(other.caller, 1000.0)
print(other.caller(2), Watch.seen)
jit.thread_time = lambda: next(clock)
print(caller(3), Watch.seen)  # two calls of the clock: helper is not interpreted
print(next(clock))
""",
    ),
    "at once": (
        {"helper": HELPER.format(1)},
        """
from helper import helper
jit.expect(helper, 0.01)
print(helper(1), Watch.seen)
jit.expect(helper, 1000.0)
print(helper(1), Watch.seen)
""",
    ),
    "written out": (
        {"loop": WRITTEN_OUT},
        """
from loop import loop, part
interpreted = loop(50)
jit.expect(loop, 1000.0)
print(loop(50) == interpreted, sorted(Watch.seen), part(1.0, 4))
""",
    ),
    "strange numbers": ({"strange_numbers": STRANGE}, NUMBERS),
    "strange numbers, compiled": (
        {"strange_numbers": STRANGE},
        "import strange_numbers; jit.expect(strange_numbers.strange, 1000.0)\n" + NUMBERS,
    ),
    "numbers in a call": (
        {"helper": HELPER.format(1), "caller": NUMBERS_IN_A_CALL},
        """
from caller import caller, helper
jit.expect(caller, 1000.0)
print(caller(1), len(helper.machine.signatures))
""",
    ),
    "kept": (
        {"helper": HELPER.format(1)},
        "from helper import helper; jit.expect(helper, 1000.0); print(helper(1))",
    ),
}
ONE_AFTER_ANOTHER = """
import contextlib, io, json, sys, traceback
clock, said = jit.thread_time, {}
for name, folder, code in json.loads(PROGRAMS):
    jit.thread_time, Watch.seen = clock, []
    before = {*sys.modules}
    sys.path.insert(0, folder)
    with contextlib.redirect_stdout(io.StringIO()) as out:
        try:
            exec(code, {"jit": jit, "Watch": Watch})
        except Exception:
            traceback.print_exc(file=out)
    sys.path.remove(folder)
    for module in {*sys.modules} - before:  # the next one has others of the same names
        if (getattr(sys.modules[module], "__file__", None) or "").startswith(folder):
            del sys.modules[module]
    said[name] = out.getvalue().splitlines()
print(json.dumps(said))
"""


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of the programs, and of the machine code that is kept."""
    return tmp_path_factory.mktemp("patient")


@pytest.fixture(scope="module")
def said(root: Path) -> dict[str, list[str]]:
    """Return what each program prints where nothing is compiled first.

    One interpreter runs them all, since most of the time goes into starting it.
    """
    programs = []
    for i, (name, (modules, code)) in enumerate(PROGRAMS.items()):
        folder = root / str(i)
        folder.mkdir()
        for module, text in modules.items():
            (folder / f"{module}.py").write_text(text)
        programs.append((name, str(folder), code))
    code = WATCH + ONE_AFTER_ANOTHER.replace("PROGRAMS", repr(json.dumps(programs)))
    (printed,) = run(code, root, NUMBA_CACHE_DIR=str(root / "kept"), **PATIENT)
    found: dict[str, list[str]] = json.loads(printed)
    return found


def test_it_is_interpreted_until_it_has_taken_long(said: dict[str, list[str]]) -> None:
    """Also what it calls; and no sooner is it compiled than when it is called again."""
    assert said["until it has taken long"] == ["4 6 []", "8 ['caller', 'helper']"]


def test_in_parts_only_what_takes_long_itself_is_compiled(said: dict[str, list[str]]) -> None:
    """Once it is compiled, for whichever function, its machine code is called."""
    assert said["in parts"] == [
        "4 []",
        "6 ['caller', 'helper']",
        "8 ['caller', 'helper']",
        "0.2",
    ]


def test_what_would_take_long_is_compiled_at_once(said: dict[str, list[str]]) -> None:
    assert said["at once"] == ["2 []", "2 ['helper']"]


def test_what_is_written_out_is_the_same_and_has_no_machine_code_of_its_own(
    said: dict[str, list[str]],
) -> None:
    assert said["written out"] == [f"True ['loop'] {(1.0 * 1.1 + 4, 1)}"]


def test_numbers_that_stand_in_a_call_make_no_version_of_their_own(
    said: dict[str, list[str]],
) -> None:
    assert said["numbers in a call"] == ["3 1"]


def test_interpreted_numbers_are_those_of_machine_code(said: dict[str, list[str]]) -> None:
    """Without warnings, where Python's own would be errors; no product and sum are one
    operation.
    """
    assert said["strange numbers"] == said["strange numbers, compiled"]
    assert len(said["strange numbers"]) == 1


def test_a_copy_at_another_path_has_nothing_on_the_disk_and_says_nothing_again(
    said: dict[str, list[str]], root: Path
) -> None:
    """A second process finds what the first one kept, and does not say that it compiles."""
    assert said["kept"] == ["2"]
    here, there = root / str(len(PROGRAMS) - 1), root / "copy"
    there.mkdir()
    (there / "helper.py").write_text((here / "helper.py").read_text())
    code = f"""
import sys
sys.stderr = sys.stdout
for folder in {[str(here), str(there)]}:
    sys.path.insert(0, folder)
    from helper import helper
    print(helper(1), helper._may_be_kept, Watch.seen, len(helper.machine.signatures))
    del sys.modules["helper"], sys.path[0]
sys.path.insert(0, folder)
from helper import helper
jit.expect(helper, 1000.0)
print(helper(1j), Watch.seen)
"""
    found = run(WATCH + code, NUMBA_CACHE_DIR=str(root / "kept"), **PATIENT)
    assert found == ["2 True [] 1", "2 False [] 0", "(1+1j) ['helper']"]


@pytest.mark.slow
def test_the_disk_is_searched_only_where_a_checkout_keeps_its_code(tmp_path: Path) -> None:
    """A copy of the sources at another path has none of it, and asks numba for none."""
    kept = {"NUMBA_CACHE_DIR": str(tmp_path / "kept"), **PATIENT}
    found = []
    for name in ("here", "there"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "helper.py").write_text(HELPER.format(1))
        code = "from helper import helper; helper(1); print(helper._may_be_kept)"
        first = "from helper import helper; jit.expect(helper, 1000.0); helper(1)\n"
        if name == "here":
            run(WATCH + first, tmp_path / name, **kept)
        found += run(WATCH + code, tmp_path / name, **kept)
    assert found == ["True", "False"]


@pytest.mark.slow
def test_machine_code_is_used_where_numba_has_it_on_its_disk(tmp_path: Path) -> None:
    """It has none of other sources, of another version of numba, and for other arguments."""
    file, kept = (
        tmp_path / "helper.py",
        {"NUMBA_CACHE_DIR": str(tmp_path / "kept"), "PYTHONDONTWRITEBYTECODE": "1"},
    )

    def runs(argument: str, before: str = "") -> list[str]:
        code = (
            f"from helper import helper; print(helper({argument}), Watch.seen, "
            "len(helper.machine.signatures))"
        )
        return run(WATCH + before + code, tmp_path, **kept, **PATIENT)

    file.write_text(HELPER.format(1))
    assert runs("1") == ["2 [] 0"]
    run("from helper import helper; helper(1)", tmp_path, **kept, ELICIT_COMPILE_FIRST="1")
    assert runs("1") == ["2 [] 1"]
    if not thorough():
        return
    assert runs("1.5") == ["2.5 [] 0"]
    assert runs("1", "import numba; numba.__version__ = 'another'\n") == ["2 [] 0"]
    file.write_text(HELPER.format(10))
    assert runs("1") == ["11 [] 0"]


@pytest.mark.slow
def test_interpreted_numbers_are_those_of_a_process_that_compiles_and_of_one_that_cannot(
    said: dict[str, list[str]], tmp_path: Path
) -> None:
    """Without warnings, where Python's own would be errors; no product and sum are one
    operation.
    """
    (tmp_path / "strange_numbers.py").write_text(STRANGE)
    kept = {"NUMBA_CACHE_DIR": str(tmp_path / "kept")}
    machine = run(NUMBERS, tmp_path, **kept, ELICIT_COMPILE_FIRST="1")[-1]
    assert said["strange numbers"] == [machine]
    assert run(NUMBERS, tmp_path, **kept, NUMBA_DISABLE_JIT="1") == [machine]


@pytest.mark.slow
def test_numbers_in_a_call_make_no_version_where_all_is_compiled_first(tmp_path: Path) -> None:
    (tmp_path / "helper.py").write_text(HELPER.format(1))
    (tmp_path / "caller.py").write_text(NUMBERS_IN_A_CALL)
    code = "from caller import caller, helper; print(caller(1), len(helper.machine.signatures))"
    assert run(code, tmp_path, NUMBA_CACHE_DIR=str(tmp_path / "kept"))[-1] == "3 1"
