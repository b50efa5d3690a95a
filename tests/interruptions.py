"""Ctrl+C at any line of a call: what the call leaves behind must be usable."""

import linecache
import sys
from collections.abc import Callable, Iterator, Sequence
from dis import opmap
from pathlib import Path
from types import FrameType
from typing import Any, TypeVar

from tests.thoroughness import scaled

T = TypeVar("T")

_ROOT = Path(__file__).parents[1]


def interrupted_at_each_line(
    make: Callable[[], T], act: Callable[[T], Any], folders: Sequence[str] = ("elicit", "qlearn")
) -> Iterator[T]:
    """Yield what ``make`` returns after a KeyboardInterrupt broke off ``act`` on it, for each line
    of the code in these folders that ``act`` runs: before that line runs for the first time, and
    before it runs for the last time. In a quick run, at every twentieth of these moments."""
    code = tuple(str(_ROOT / folder) + "/" for folder in folders)
    _traced(make(), act, code, None)  # so that nothing is loaded or made for the first time below
    lines = _traced(make(), act, code, None)
    last = {line: i for i, line in enumerate(lines)}
    first = {line: i for i, line in reversed([*enumerate(lines)])}
    wanted = sorted({*first.values(), *last.values()})
    assert wanted, "no line of these folders was run"
    for i in [*wanted[: -1 : scaled(20, 1)], wanted[-1]]:
        made = make()
        try:
            _traced(made, act, code, i)
        except KeyboardInterrupt:
            yield made


def _traced(
    made: T, act: Callable[[T], Any], code: tuple[str, ...], at: int | None
) -> list[tuple[str, int]]:
    """Call ``act``, to be interrupted at the line of this number; the lines that it ran of files
    whose paths begin with one of ``code``."""
    lines: list[tuple[str, int]] = []

    def trace(frame: FrameType, event: str, _: Any) -> Any:
        if not frame.f_code.co_filename.startswith(code):
            return None
        if event == "line":
            lines.append((frame.f_code.co_filename, frame.f_lineno))
            if len(lines) - 1 == at and not _leaves_a_block(frame):
                sys.settrace(None)
                raise KeyboardInterrupt
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        act(made)
    finally:
        sys.settrace(before)
    return lines


def _leaves_a_block(frame: FrameType) -> bool:
    """Return whether the next instruction ends a with statement whose body is over.

    Python looks for signals at calls, and there is none.
    """
    line = linecache.getline(frame.f_code.co_filename, frame.f_lineno)
    return (
        line.lstrip().startswith("with ")
        and frame.f_code.co_code[frame.f_lasti] == opmap["LOAD_CONST"]
    )
