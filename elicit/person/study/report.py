"""The report of a study: one HTML file, without scripts or links."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from elicit.person.course.conclusion import per_hundred, with_probability
from elicit.person.findings import guess_in_words
from elicit.person.report import (
    STYLE,
    ReportDetails,
    asked_about,
    colour_of,
    conflict_box,
    counted,
    escaped,
    interval_picture,
    technical_details,
)

_MORE_STYLE = """
.wide { overflow-x: auto; } .wide table { table-layout: auto; } .wide td { white-space: nowrap; }
.wide th { overflow-wrap: normal; }
.each td, .each th { border-top: 0; padding: .1rem .6rem; vertical-align: middle; overflow-wrap: anywhere; }
.each .level { border-top: 1px solid var(--line); font-weight: 600; padding-top: .5rem; }
.each .name { width: 22%; } .each .drawn { width: auto; } .each .number { width: 28%; }
.mark { font-weight: 600; }
blockquote { margin: .4rem 0; padding: .1rem .9rem; border-left: 3px solid var(--edge); }
@media (max-width: 34rem) { .each td, .each th { padding: .1rem .2rem; } .each .drawn { padding: 0 .7rem; } }
"""  # noqa: E501
_SCALES = (
    "Values go from 0, the worst level, to 100, the best. A level at 60 is as good to the person "
    "as 60 of 100 at the best level and 40 at the worst. The bar is the range, and the dot is the "
    "best guess. A dashed bar is a wide range: its best guess, with a hollow dot, is not "
    "exact yet, and has no number where the range is over 40. “Not known yet” means "
    "that none of the person's answers narrows a range."
)


@dataclass(frozen=True, eq=False)
class PersonFound:
    """Findings about one person of a study.

    Attributes
    ----------
    who : str
    end : mapping
        The end, as in the screens of ``Interview``.
    loss : float
        What the person's result can still lose, a share of the value range; nan if unknown.
    confidence : float
        The probability with which the loss is no greater: 1 if that is proven, nan if unknown.
    log, checksum : str or None
        The name of the file of the answers, and the end of its last line.
    """

    who: str
    end: Mapping[str, Any]
    loss: float
    log: str | None = None
    checksum: str | None = None
    confidence: float = math.nan


@dataclass(frozen=True)
class FollowingTable:
    """A table of each person's loss from following another's policy or choice.

    Attributes
    ----------
    rows, columns : sequence of str
        The people who lose, and the people who are followed.
    losses, bounds : sequence of sequence of float
        Losses by the best guesses, and upper bounds, as shares of the value range.
    note : str
        Sentences on what the numbers are.
    """

    rows: Sequence[str]
    columns: Sequence[str]
    losses: Sequence[Sequence[float]]
    bounds: Sequence[Sequence[float]]
    note: str


def study_page(
    title: str,
    when: str,
    people: Sequence[PersonFound],
    agreed: Mapping[str, Any],
    following: FollowingTable | None,
    details: ReportDetails,
) -> str:
    """Return the report of a study as HTML.

    Parameters
    ----------
    title : str
    when : str
        The date, shown as it is given.
    people : sequence of PersonFound
    agreed : mapping
        The reply to ``agreement`` (see ``study``).
    following : FollowingTable, optional
        None if the cost of following another cannot be computed.
    details : ReportDetails

    Returns
    -------
    str
    """
    name = f"{title or 'A study'}: report of a study"
    total = sum(one.end["counts"]["answered"] for one in people)
    parts = [
        f"<h1>{escaped(name)}</h1>",
        f'<p class="soft">{escaped(when)}. {_many(len(people), "person", "people")}, '
        f"{_many(total, 'answer')}.</p>",
        *_in_short(agreed, following, stated_probability(people)),
        "<h2>People</h2>",
        *_people(people),
        *_agreement(agreed),
        *_following(following),
        "<h2>Each person's result, in the words of their own page</h2>",
        *(line for one in people for line in _told(one)),
    ]
    if details.preamble or details.legend:
        parts += ["<h2>What was asked</h2>", *asked_about(details.preamble, details.legend)]
    if details.limits:
        parts.append("<h2>What this does not say</h2>")
        parts += [f"<p>{escaped(sentence)}</p>" for sentence in details.limits]
    facts = dict(details.facts or {})
    for one in people:
        if one.log is not None:
            check = "" if one.checksum is None else f" (checksum of the last line {one.checksum})"
            facts[f"Log of {one.who}"] = f"{one.log}{check}"
    parts += technical_details(facts)
    body = "\n".join(parts)
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escaped(name)}</title>\n<style>{STYLE}{_MORE_STYLE}</style>\n</head>\n"
        f"<body>\n<main>\n{body}\n</main>\n</body>\n</html>\n"
    )


def stated_probability(people: Sequence[PersonFound]) -> str:
    """Return the probability with which bounds on losses hold, in words; "" if they are proven."""
    return " or ".join(sorted({with_probability(one.confidence) for one in people} - {""}))


def _in_short(
    agreed: Mapping[str, Any], following: FollowingTable | None, sure: str
) -> Iterator[str]:
    """Return the two most important sentences: groups, and the greatest loss by the mean policy."""
    if agreed["few"]:
        yield f'<p class="headline">{escaped(agreed["few"])}</p>'
        return
    yield f'<p class="headline">{escaped(agreed["groups"][0])}</p>'
    if following is None:
        return
    last = [(row[-1], -i) for i, row in enumerate(following.losses)]
    i = -max(last)[1]
    yield (
        f"<p>What is best for the mean of all scales costs {escaped(following.rows[i])} the most: "
        f"{per_hundred(last[i][0])} of the value range by the best guess, and "
        f"{f'{sure} ' if sure else ''}at most {per_hundred(following.bounds[i][-1])}.</p>"
    )


def _people(people: Sequence[PersonFound]) -> Iterator[str]:
    yield (
        '<div class="wide"><table>\n<thead><tr><th scope="col">Person</th>'
        '<th scope="col">Answers</th><th scope="col">Repeats as before</th>'
        '<th scope="col">Result</th><th scope="col">It can lose at most</th></tr></thead>\n<tbody>'
    )
    for one in people:
        counts = one.end["counts"]
        again = f"{counts['alike']} of {counts['repeated']}" if counts["repeated"] else "none"
        loss = "unknown" if one.loss != one.loss else per_hundred(one.loss)  # nan
        result = "settled" if one.end["settled"] else "not settled"
        cells = (str(counts["answered"]), again, result, loss)
        yield (
            f'<tr><th scope="row">{escaped(one.who)}</th>'
            f"{''.join(f'<td>{escaped(cell)}</td>' for cell in cells)}</tr>"
        )
    yield "</tbody>\n</table></div>"
    sure = stated_probability(people)
    each = f" Each holds {sure}." if sure else ""
    yield (
        '<p class="soft">A loss is a share of the value range, from the worst level to the best, '
        f"by the person's own scale.{each}</p>"
    )


def _agreement(agreed: Mapping[str, Any]) -> Iterator[str]:
    if agreed["few"]:
        return
    yield "<h2>What the levels are worth to each</h2>"
    yield (
        f'<table class="each">\n<caption>{_SCALES} The ranges hold '
        f"{escaped(agreed['certainty'])}.</caption>"
    )
    marks = "".join(f'<text x="{x}%" y="14" text-anchor="middle">{x}</text>' for x in (0, 50, 100))
    axis = f'<svg height="18" font-size="13" fill="#4a5864" aria-hidden="true">{marks}</svg>'
    yield (
        f'<thead><tr><th scope="col" class="name">Person</th><td class="drawn">{axis}</td>'
        '<th scope="col" class="number">Best guess (range)</th></tr></thead>\n<tbody>'
    )
    last = max(1, len(agreed["levels"]) - 1)
    for i, level in enumerate(agreed["levels"]):
        yield (
            f'<tr><th scope="rowgroup" class="level" colspan="3">{escaped(level["label"])}</th>'
            "</tr>"
        )
        for one in level["each"]:
            yield _value(one, colour_of(1.0 - i / last))
    yield "</tbody>\n</table>"
    if agreed["questions"]:
        yield "<h2>Questions that divide these people most</h2>"
        yield "<p>Talk about these first. The first in the list divides the most.</p>\n<ol>"
        for question in agreed["questions"]:
            each = ", ".join(f"{name} {chance}%" for name, chance in question["prefers"])
            yield (
                f'<li>{escaped(question["text"])}<br><span class="soft shown">Chance that each '
                f"prefers the first: {escaped(each)}.</span></li>"
            )
        yield "</ol>"
    yield "<h2>Groups</h2>"
    yield from (f"<p>{escaped(sentence)}</p>" for sentence in agreed["groups"])


def _value(one: Mapping[str, Any], colour: str) -> str:
    low, high = one["low"], one["high"]
    rough = one.get("rough", False)
    picture = interval_picture(low, one["value"], high, colour if one["known"] else None, rough)
    guess = guess_in_words(one["value"], one["known"], rough)
    words = f"{low:.0f}" if low == high else f"{low:.0f} to {high:.0f}"
    if guess and low != high:
        words = f"{guess} ({words})"
    return (
        f'<tr><th scope="row" class="name">{escaped(one["who"])}</th>'
        f'<td class="drawn">{picture}</td><td class="number">{words}</td></tr>'
    )


def _following(found: FollowingTable | None) -> Iterator[str]:
    if found is None:
        return
    yield "<h2>What it costs to follow one another</h2>"
    yield f"<p>{escaped(found.note)}</p>"
    head = "".join(f'<th scope="col">{escaped(name)}</th>' for name in found.columns)
    yield f'<div class="wide"><table>\n<thead><tr><th scope="col">Who loses</th>{head}</tr></thead>'
    yield "<tbody>"
    for name, losses, bounds in zip(found.rows, found.losses, found.bounds, strict=True):
        cells = "".join(
            f'<td><span class="mark">{100 * loss:.1f}</span> ({100 * bound:.1f})</td>'
            for loss, bound in zip(losses, bounds, strict=True)
        )
        yield f'<tr><th scope="row">{escaped(name)}</th>{cells}</tr>'
    yield "</tbody>\n</table></div>"


def _told(one: PersonFound) -> Iterator[str]:
    """Return a person's result in words, with their answers that contradict each other."""
    end = one.end
    yield f'<p><span class="mark">{escaped(one.who)}</span>: {escaped(counted(end["counts"]))}</p>'
    said = [
        end[part]
        for part in ("headline", "caution", "follows", "effect", "sure", "size", "before")
        if end.get(part)
    ]
    said += [*end["remarks"], *end["statements"]]
    lines = "".join(f"<p>{escaped(sentence.strip())}</p>" for sentence in said)
    yield f"<blockquote>{lines}</blockquote>"
    yield from map(conflict_box, end["conflicts"])


def _many(n: int, one: str, several: str = "") -> str:
    return f"{n} {one if n == 1 else several or f'{one}s'}"
