"""Compiled or not, the same numbers to the last bit; and the machine code on disk is that of today's sources."""

import hashlib
import re
from pathlib import Path

import numpy as np

from elicit import Answers, BradleyTerryTutor, FlippingTutor, PolytopeComparator, decide
from elicit._support import jit
from tests.interpreter import report_of, run
from tests.lp_cases import cases


def report() -> list[str]:
    """One line a case: its kind, verdicts, tiers, and a hash of bounds and values, to the last bit."""
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


def test_compiled_and_interpreted() -> None:
    ours = report()
    assert len({line.split()[0] for line in ours}) > 10
    assert {tier for line in ours for tier in line.split("] [")[1].split("]")[0].split(", ")} >= set("012345")
    assert report_of(__name__) == ours


def test_numba_is_imported_only_when_a_comparator_needs_it() -> None:
    code = "import sys, elicit; print('numba' in sys.modules); elicit.PolytopeComparator; print('numba' in sys.modules)"
    assert run(code) == ["False", "True"]


HELPER = "from elicit._support.jit import compiled\n@compiled\ndef helper(x):\n    return x + {}\n"
CALLER = """from elicit._support.jit import compiled
from helper import helper
@compiled
def caller(x):
    return 2 * helper(x)
"""


def test_a_change_in_another_file_is_seen(tmp_path: Path) -> None:
    """numba keeps ``caller`` as it was compiled while its own file stays the same."""
    (tmp_path / "caller.py").write_text(CALLER)
    code = "from caller import caller; print(caller(1))"
    for summand, result in ((1, "4"), (10, "22"), (1, "4")):
        (tmp_path / "helper.py").write_text(HELPER.format(summand))
        assert run(code, tmp_path, NUMBA_CACHE_DIR=str(tmp_path / "kept"), PYTHONDONTWRITEBYTECODE="1") == [result]
    assert len({path.parent for path in (tmp_path / "kept").rglob("caller*.nbi")}) == 2


def test_what_else_was_imported_before_makes_no_difference_to_where_ours_is_kept(tmp_path: Path) -> None:
    (tmp_path / "helper.py").write_text(HELPER.format(1))
    code = "from elicit._support.hashing import mix; import numpy as np; mix(np.uint64(1), np.uint64(2))"
    run(code, tmp_path, NUMBA_CACHE_DIR=str(tmp_path / "kept"))
    kept = set((tmp_path / "kept").rglob("*.nbi"))
    run("import helper; " + code, tmp_path, NUMBA_CACHE_DIR=str(tmp_path / "kept"))
    assert len(kept) >= 1
    assert set((tmp_path / "kept").rglob("*.nbi")) == kept


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


def test_the_first_call_on_a_machine_says_what_it_waits_for_and_that_it_is_over(tmp_path: Path) -> None:
    """Neither other functions nor other processes say it again; and numba's settings stay as they were."""
    (tmp_path / "helper.py").write_text(HELPER.format(1))
    kept = str(tmp_path / "kept")
    code = "import sys, numba, helper; sys.stderr = sys.stdout; helper.helper(1); helper.helper(1.5)"
    show = "; print(numba.config.CACHE_DIR)"
    began, settings, ended = run(code + show, tmp_path, NUMBA_CACHE_DIR=kept)
    assert began.startswith("elicit: compiling, once on this machine")
    assert settings == kept
    assert re.fullmatch(r"elicit: compiled, in \d+ s", ended)
    assert run(code, tmp_path, NUMBA_CACHE_DIR=kept) == []
    assert run(code + "; helper.helper(1j)", tmp_path, NUMBA_CACHE_DIR=kept) == []


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
    assert (began.split(",")[0], ended.split(",")[0], later) == ("elicit: compiling", "elicit: compiled", "later")


def test_of_processes_that_compile_beside_each_other_one_says_so(tmp_path: Path) -> None:
    code = "from elicit._support.jit import first_on_this_machine as first; print(first(), first())"
    both = [run(code, NUMBA_CACHE_DIR=str(tmp_path)) for _ in range(2)]
    assert both == [["True False"], ["False False"]]
    (tmp_path / "file").write_text("where no folder can be made")
    assert run(code, NUMBA_CACHE_DIR=str(tmp_path / "file")) == ["True True"]  # it is compiled each time, too


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
