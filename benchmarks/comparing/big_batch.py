"""One big batch of differences, judged in a process of its own: seconds and peak extra memory."""

from __future__ import annotations

from statistics import median
from time import perf_counter

import numpy as np

from benchmarks.comparing.recorded_streams import Stream
from benchmarks.own_process import apart, memory
from benchmarks.reporting import markdown
from elicit import Answers, PolytopeComparator, TruthfulTutor, Verdict
from elicit.model.scale import Floats


def report(stream: Stream, n: int, n_answers: int, margin: float, seed: int) -> list[str]:
    """Lines on a batch of n differences after so many of the stream's answers."""
    answers = just(n_answers, stream, margin, seed)
    found = apart(measure, answers, differences(stream, n, seed), margin)
    cells = [
        "PolytopeComparator, one fresh batch",
        f"{found['seconds']:.3f}",
        f"{1e6 * found['seconds'] / n:.2f}",
    ]
    cells.append(f"{found['bytes'] / 1e6:.0f}")
    drawn = n_answers - min(n_answers, len(stream.answers))
    return [
        f"## A batch of {n:,} differences, k = {stream.k}, after {n_answers} answers",
        "",
        f"{n - n // 10:,} rows drawn from the stream above with replacement, {n // 10:,} fresh "
        "normal rows of total 0; "
        + (
            f"{drawn} of the answers are to random undecided pairs, as the run had fewer. "
            if drawn
            else ""
        )
        + f"{found['unknown']:.1%} UNKNOWN.",
        "",
        *markdown(("method", "seconds", "us a comparison", "peak extra memory, MB"), [cells], 1),
    ]


def just(n: int, stream: Stream, margin: float, seed: int) -> Answers:
    """The stream's first n answers, continued by true answers to random undecided pairs where it
    has fewer.
    """
    answers, tutor, rng = (
        stream.answers[:n],
        TruthfulTutor(stream.values),
        np.random.default_rng(seed),
    )
    comparator = PolytopeComparator(stream.k, margin).update(answers)
    while len(answers) < n:
        left, right = rng.dirichlet(np.ones(stream.k), (2, 1000))
        undecided = (left - right)[comparator.compare(left - right) == Verdict.UNKNOWN][:1]
        new = (
            Answers(undecided, tutor.signs(undecided)) if len(undecided) else Answers.none(stream.k)
        )
        comparator, answers = comparator.update(new), answers + new
    return answers


def differences(stream: Stream, n: int, seed: int) -> Floats:
    """(n, k): nine in ten drawn from the stream with replacement, the others normal with total 0,
    shuffled.
    """
    rng = np.random.default_rng(seed)
    recorded = np.concatenate([d for _, d in stream.segments])
    fresh = rng.normal(size=(n // 10, stream.k))
    fresh -= fresh.mean(axis=1, keepdims=True)
    rows = np.concatenate([recorded[rng.integers(len(recorded), size=n - len(fresh))], fresh])
    rng.shuffle(rows)
    return rows


def measure(answers: Answers, d: Floats, margin: float) -> dict[str, float]:
    """Seconds, extra bytes at the peak, and the share of UNKNOWN, in this process."""
    PolytopeComparator(answers.k, margin).update(answers).compare(
        d[:1000]
    )  # compiles what is to be compiled
    seconds, extra = [], []
    for _ in range(3):
        comparator = PolytopeComparator(answers.k, margin).update(answers)
        before, start = memory("VmRSS"), perf_counter()
        verdicts = comparator.compare(d)
        seconds.append(perf_counter() - start)
        extra.append(memory("VmHWM") - before)
    # the first pass needs the most: a later one finds memory that was not given back
    return {
        "seconds": median(seconds),
        "bytes": float(extra[0]),
        "unknown": float(np.mean(verdicts == Verdict.UNKNOWN)),
    }
