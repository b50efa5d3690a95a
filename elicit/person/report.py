"""The page that a person keeps of a session: one HTML file, without scripts or links."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

from elicit.person.course.counts import Counts, in_answers
from elicit.person.findings import guess_in_words, is_narrower

# from the worst level to the best, as the page interview.js has them
COLOURS = {
    "light": (
        (36, 20, 44),
        (130, 11, 43),
        (111, 77, 18),
        (60, 111, 122),
        (47, 134, 172),
        (89, 151, 227),
    ),
    "dark": (
        (205, 76, 47),
        (219, 118, 46),
        (217, 161, 63),
        (145, 203, 209),
        (167, 220, 246),
        (212, 235, 253),
    ),
}
STYLE = """
:root { --ink: #14202b; --soft: #4a5864; --line: #d9e0e6; --edge: #c9d2da; --back: #fff; --link: #0b4f8a; --tint: #e6f0f9;
  --warn: #b45f00; --warn-tint: #fff4dc; color-scheme: light dark; }
svg .level { fill: var(--light); }
@media screen and (prefers-color-scheme: dark) {
  :root { --ink: #e8eef3; --soft: #aab8c4; --line: #3a4854; --edge: #3a4854; --back: #10161c; --link: #8cc4f5; --tint: #16324a;
    --warn: #e0923a; --warn-tint: #3a2a12; }
  svg rect, svg circle[r="6"], svg .rough { stroke: #97a5b1; }
  svg .level { fill: var(--dark); } svg .rough:not([fill="none"]) { fill: var(--back); }
}
svg text { fill: var(--soft); } svg line { stroke: var(--line); }
body { margin: 2rem auto; max-width: 52rem; padding: 0 1rem; color: var(--ink); background: var(--back);
  font: 16px/1.45 system-ui, -apple-system, "Segoe UI", "DejaVu Sans", sans-serif; overflow-wrap: anywhere; }
h1 { font-size: 1.6rem; line-height: 1.25; margin: 0; } h2 { font-size: 1.15rem; margin: 1.8rem 0 .4rem; }
p, ul { margin: .4rem 0; } .soft { color: var(--soft); }
table { border-collapse: collapse; table-layout: fixed; width: 100%; font-variant-numeric: tabular-nums; }
caption { text-align: left; color: var(--soft); padding-bottom: .4rem; }
th, td { box-sizing: border-box; text-align: left; vertical-align: top; font-weight: 400; padding: .3rem .6rem;
  border-top: 1px solid var(--line); }
thead th, thead td { font-size: .85rem; color: var(--soft); border-top: 0; vertical-align: bottom; }
.number { text-align: right; } .guess { width: 17%; } .range { width: 15%; } .drawn { width: 43%; padding: 0 1.2rem; }
.scale tfoot { display: none; } .scale:has(td.given) .drawn { width: 34%; } th.given { width: 17%; }
.scale tbody * { vertical-align: middle; } .nr { width: 3.2rem; overflow-wrap: normal; } .when { width: 9.6rem; } .remarks { width: 20%; }
.marked td { font-weight: 600; background: var(--tint); }
.chosen { font-size: .85em; border: 1px solid var(--link); color: var(--link); border-radius: 6px; padding: 0 .4em; white-space: nowrap; }
.levels th { width: 34%; } .many th:first-child { width: 26%; }
svg { display: block; width: 100%; overflow: visible; }
.conflict { border: 1.5px solid var(--warn); background: var(--warn-tint); border-radius: 8px; padding: .2rem 1rem;
  margin: .8rem 0; }
.shown { font-size: .85rem; }
.headline { font-size: 1.35rem; font-weight: 700; line-height: 1.3; margin-top: 1rem; }
.caution { border-left: 4px solid var(--warn); background: var(--warn-tint); padding: .4rem .8rem; }
dl { display: grid; grid-template-columns: max-content 1fr; gap: .2rem 1rem; font-size: .85rem; color: var(--soft); }
dd { margin: 0; overflow-wrap: anywhere; }
.log { border-top: 1px solid var(--edge); margin-top: 2rem; padding-top: .6rem; font-size: .85rem; }
summary { cursor: pointer; color: var(--link); padding: .3rem 0; } details > table { margin-top: .4rem; }
.wide td.number { white-space: nowrap; } .wide thead th { overflow-wrap: break-word; } .answers td:nth-child(3) { font-size: .85rem; }
@media (min-width: 44rem) { .answers td:nth-child(3) { white-space: nowrap; } .wide { table-layout: auto; } .wide th, .wide td { overflow-wrap: break-word; } }
@media (max-width: 34rem) {
  body { margin-top: 1rem; } table { font-size: .9rem; } th, td { padding: .3rem .2rem; }
  .scale, .scale thead, .scale tbody, .scale caption, .answers, .answers tbody { display: block; }
  .scale tr { display: grid; grid-template-columns: minmax(0, 1fr) 7rem 5.5rem; border-top: 1px solid var(--line); }
  .scale thead tr { border-top: 0; } .scale th, .scale td { border-top: 0; width: auto; }
  .scale thead .drawn { display: none; } .scale tfoot { display: block; }
  .scale .drawn { grid-row: 2; grid-column: 1 / -1; padding: 0 .8rem; } .scale tbody .drawn { margin-top: -.5rem; }
  .scale:has(td.given) .drawn { width: auto; } .scale:has(td.given) tr { grid-template-columns: minmax(0, 1fr) minmax(0, 1fr); } .scale:has(td.given) th:not(:first-child, .guess) { display: none; }
  .scale td.given, .scale:has(td.given) td.range { grid-row: 3; text-align: left; } .scale td.given:empty, .scale:has(td.given) td.fixed { display: none; }
  .scale td.given::before, .scale:has(td.given) td.range::before { content: attr(data-head); display: block; font-size: .85em; color: var(--soft); }
  .answers thead, .many thead { display: none; } .many, .many tbody { display: block; }
  .many tr { display: grid; grid-template-columns: repeat(2, minmax(0, 1fr)); gap: 0 1.2rem; padding: .4rem 0; border-top: 1px solid var(--line); }
  .many td { border-top: 0; padding: .1rem 0; display: flex; justify-content: space-between; gap: .6rem; }
  .many td:first-child { grid-column: 1 / -1; font-weight: 600; justify-content: flex-start; }
  .many td:not(:first-child)::before { content: attr(data-head); color: var(--soft); overflow-wrap: normal; }
  .many .marked { padding: .4rem .6rem; background: var(--tint); } .many .marked td { background: none; }
  .many td.number:last-child { grid-column: 1 / -1; }
  .many td:not(:first-child, .number) { grid-column: 1 / -1; justify-content: flex-start; }
  .many td:not(:first-child, .number)::before { flex: 0 0 8.5rem; overflow-wrap: normal; }
  .answers tr { display: grid; grid-template-columns: 2.2rem minmax(0, 1fr); border-top: 1px solid var(--line); }
  .answers td { border-top: 0; padding: .1rem .2rem; } .answers td:nth-child(n+3) { grid-column: 2; }
  .answers td:empty { display: none; }
}
.wide.many { font-size: .82rem; }
.printed { display: none; }
@page { margin: 14mm; }
@media print {
  body { margin: 0; max-width: none; font-size: 9.5pt; line-height: 1.35; } thead { display: table-header-group; }
  h1 { font-size: 15pt; } h2 { font-size: 11.5pt; margin: 1rem 0 .3rem; } .headline { font-size: 12.5pt; }
  table { font-size: 8pt; } .scale { font-size: 9.5pt; } th, td { padding: .12rem .4rem; } .shown { font-size: 7.5pt; }
  thead th, thead td, dl { font-size: 8pt; } .when { width: 8rem; } .answers td:nth-child(3) { font-size: 8pt; white-space: nowrap; } .nr { width: 2rem; } .remarks { width: 22%; }
  svg { height: 24px; } thead svg { height: 18px; }
  tr, .conflict, h2 { break-inside: avoid; } h2 { break-after: avoid; }
  .long, .cut tbody tr:nth-child(n+41) { display: none; } .printed { display: block; font-style: italic; }
  summary { list-style: none; color: inherit; } summary::-webkit-details-marker { display: none; }
  details::details-content { content-visibility: visible; block-size: auto; }
  * { print-color-adjust: exact; -webkit-print-color-adjust: exact; }
}
"""  # noqa: E501


_MOST_PRINTED = 40  # rows of a table, as the style has it: the paper is for reading, not for filing
_FEW_COLUMNS = 3  # that fit beside each other on a phone
_NUMBER = re.compile(r"-|not known yet|-?\d[\d.,]*( to \d+)?( \((at least|or) [^)]*\))?")


IF_NO_MISTAKE = "If no answer is a mistake"
"""The head of the column of ranges that take every answer as given."""
_WITH_MISTAKES = "Allowing for mistakes"
FIXED = "fixed"
"""The range of a level whose value is 0 or 100 by definition."""

ENOUGH = "Enough for this result"
"""The status of a settled result that leaves levels or states open."""
NEARLY = "Nearly settled"
"""The status of a result by which little can be lost, although questions are left."""

NAMED = {
    "values": "Your values, from 0 to 100",
    "sure": "How sure",
    "size": "How close",
    "next": "Next",
    "before": "Before",
}
"""The names of parts of a conclusion on screens and in reports, in their order."""


@dataclass(frozen=True)
class ReportDetails:
    """Further parts of a report.

    Attributes
    ----------
    who : str
        The person who answered.
    log : str, optional
        The name of the file that holds the answers.
    checksum : str, optional
        The checksum with which the last line of that file ends.
    preamble : str
        What each question asked, followed by the text that the person saw before the first one.
    legend : mapping, optional
        The meaning of the levels, as in the screens of ``Interview``.
    source : str
        A sentence on where the figures come from, or "".
    facts : mapping, optional
        Technical facts that the report names, such as the problem and the version.
    limits : sequence of str
        Sentences on what the result does not say.
    """

    who: str = ""
    log: str | None = None
    checksum: str | None = None
    preamble: str = ""
    legend: Mapping[str, Any] | None = None
    source: str = ""
    facts: Mapping[str, str] | None = None
    limits: Sequence[str] = ()


_NO_DETAILS = ReportDetails()


def report_page(
    title: str,
    when: str,
    end: Mapping[str, Any],
    answers: Sequence[Mapping[str, Any]],
    waiting: bool,
    details: ReportDetails = _NO_DETAILS,
) -> str:
    """Return the page as HTML.

    Parameters
    ----------
    title : str
    when : str
        The date, shown as it is given.
    end, answers
        As in the replies of ``Interview``.
    waiting : bool
        True if more could be asked.
    details : ReportDetails

    Returns
    -------
    str
    """
    name = title or "Your judgement"
    person = f"Answers of {escaped(details.who)}. “You” in this report is {escaped(details.who)}. "
    person = person if details.who else "“You” in this report is the person who answered. "
    n = end["counts"]["answered"]
    parts = [
        f"<h1>{escaped(name)}: a report</h1>",
        f'<p class="soft">{person}{escaped(when)}. {escaped(in_answers(n))}.</p>',
    ]
    if waiting and not end.get("settled"):
        # a caution may have ended it, and not the person
        early = (
            "More could be asked." if end.get("caution") else "Stopped early: more could be asked."
        )
        if end.get("status") == NEARLY:
            early = "Stopped where little was left to gain."
        parts.append(f"<p><b>{early}</b> This is where things stood.</p>")
    scale = []
    if end["scale"]:
        scale = [
            "<h2>What the levels are worth</h2>",
            *_scale(end["scale"], end["certainty"], end.get("scale_notes", ())),
        ]
    parts += _headline(end)
    asked = []
    if details.preamble or details.legend:
        asked = ["<h2>What was asked</h2>", *asked_about(details.preamble, details.legend)]
    follows, remarks = _conclusion(end), _remarks(end)
    if details.source:
        follows.append(f"<p>{escaped(details.source)}</p>")
    tables = [*_changes(end), *_whole_plan(end)]
    # whoever wanted to know the values sees them first, and a plan is then an appendix
    heading = _unbroken(escaped(end.get("follows") or ""))
    apart = bool(heading and end.get("plan"))
    if heading:
        parts += [*scale, *asked]
    if apart:
        parts += remarks
    else:
        parts += [f"<h2>{heading}</h2>"] if heading else []
        parts += [*follows, *remarks]
    if end["open"]:
        parts.append(f"<p>{escaped(end['open'])}</p>")
    if not heading:
        parts += scale
    if end["conflicts"]:
        parts.append("<h2>Answers that contradict each other</h2>")
        parts += map(conflict_box, end["conflicts"])
    if end["statements"]:
        parts += ["<h2>What else follows</h2>", *_statements(end["statements"])]
    if not apart:
        parts += tables
    if not heading:
        parts += asked
    found = Counts.read(end["counts"])
    each = ((found.withdrawn, "taken back"), (found.not_kept, "not kept"))
    besides = "".join(f", {some} {words}" for some, words in each if some)
    listed = f"Every answer, oldest first ({found.answered} that stand{besides})"
    checks = f"{counted(end['counts'])} {end.get('by_chance', '')}".strip()
    parts += ["<h2>Answers and checks</h2>", f"<p>{escaped(checks)}</p>"]
    parts.append(f"<details><summary>{listed}</summary>")
    parts += [*_answers(answers), "</details>"]
    if apart:
        parts += ["<h2>Appendix: what follows for the plan</h2>", f"<p><b>{heading}</b></p>"]
        parts += [*follows, *tables]
    if details.limits:
        parts.append("<h2>What this does not say</h2>")
        parts += [f"<p>{escaped(sentence)}</p>" for sentence in details.limits]
    technical = dict(details.facts or {})
    if details.log is not None:
        technical["Answers are kept in"] = details.log
        if details.checksum is not None:
            technical["Checksum of its last line"] = details.checksum
    parts += technical_details(technical)
    body = "\n".join(parts)
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escaped(name)}: a report</title>\n<style>{STYLE}</style>\n</head>\n"
        f"<body>\n<main>\n{body}\n</main>\n</body>\n</html>\n"
    )


def technical_details(facts: Mapping[str, str]) -> Iterator[str]:
    """Return facts that only somebody who checks a report needs, as a folded HTML part."""
    if facts:
        named = "".join(f"<dt>{escaped(k)}</dt><dd>{escaped(v)}</dd>" for k, v in facts.items())
        yield f'<details class="log"><summary>Technical details</summary><dl>{named}</dl></details>'


def _unbroken(text: str) -> str:
    """Return a text in which neither "1 in 100" nor a level and its value are parted."""
    text = re.sub(r"(\d) in (\d)", "\\1\u00a0in\u00a0\\2", text)
    return re.sub(r" (\d+[,.:])", "\u00a0\\1", text)


def _headline(end: Mapping[str, Any]) -> Iterator[str]:
    """Return the headline, and a caution if there is one."""
    if end.get("headline"):
        yield f'<p class="headline">{_unbroken(escaped(end["headline"]))}</p>'
    if end.get("caution"):
        yield f'<p class="caution">{escaped(end["caution"])}</p>'


def _conclusion(end: Mapping[str, Any]) -> list[str]:
    """Return what follows: its effect, how sure it is, its size, and the loss before."""
    said = [f"<p>{escaped(end[name])}</p>" for name in ("effect", "reason") if end.get(name)]
    said += [
        f"<p><b>{words}:</b> {escaped(end[name])}</p>"
        for name, words in NAMED.items()
        if end.get(name) and name != "next"  # that says what to do on the screen
    ]
    return said


def _remarks(end: Mapping[str, Any]) -> list[str]:
    """Return the remarks on how the answers were given."""
    return [f'<p class="caution">{escaped(one)}</p>' for one in end.get("remarks", ())]


def _whole_plan(end: Mapping[str, Any]) -> Iterator[str]:
    """Return the plan in every state, if there is one, as a folded table."""
    if plan := end.get("plan"):
        n = len(plan["rows"])
        long = ' class="long"' if n > _MOST_PRINTED else ""
        yield f"<h2>{escaped(plan['title'])}</h2>"
        yield f"<p>{escaped(plan['note'])}</p>"
        yield f"<details{long}><summary>Every {escaped(plan['of'])} ({n})</summary>"
        yield from _rows_of(plan, cut=False)
        yield "</details>"
        if long:
            yield _not_printed(f"The table of all {n} {plan['of']}s")


def _changes(end: Mapping[str, Any]) -> Iterator[str]:
    """Return what the answers change, if anything is said of it, and what they leave open."""
    if not (changes := end.get("changes")):
        return
    yield f"<h2>{escaped(changes['title'])}</h2>"
    yield from (f"<p>{escaped(words)}</p>" for words in changes["note"].split("\n"))
    yield from _rows_of(changes)
    if still_open := changes.get("open"):
        yield f"<details><summary>{escaped(still_open['title'])}</summary>"
        yield f"<p>{escaped(still_open['note'])}</p>"
        yield from _rows_of(still_open)
        yield "</details>"


def _not_printed(what: str) -> str:
    """Return a sentence that is shown only on paper."""
    return (
        f'<p class="printed">{escaped(what)} is not printed. It is on this page on a screen, and '
        "in the tables that can be downloaded beside it.</p>"
    )


def _rows_of(table: Mapping[str, Any], cut: bool = True) -> Iterator[str]:
    """Return a table. On paper a long one is cut off, unless all of it is left out."""
    if table["rows"]:
        more = len(table["rows"]) - _MOST_PRINTED
        right = [_is_number(cells) for cells in zip(*table["rows"], strict=True)]
        kinds = [' class="number"' if i and number else "" for i, number in enumerate(right)]
        columns = [*zip(table["columns"], kinds, strict=True)]
        head = "".join(f'<th scope="col"{kind}>{escaped(name)}</th>' for name, kind in columns)
        many = " many" if len(table["columns"]) > _FEW_COLUMNS else ""
        many += " cut" if cut and more > 0 else ""
        yield f'<table class="wide{many}">\n<thead><tr>{head}</tr></thead>\n<tbody>'
        for i, row in enumerate(table["rows"]):
            chosen = i == table.get("marked")
            each = [
                f'<td data-head="{escaped(name)}"{kind}>{escaped(cell)}</td>'
                for (name, kind), cell in zip(columns, row, strict=True)
            ]
            if chosen:
                mark = f' <span class="chosen">{escaped(table["mark"])}</span></td>'
                each[0] = f"{each[0].removesuffix('</td>')}{mark}"
            which = ' class="marked"' if chosen else ""
            yield f"<tr{which}>{''.join(each)}</tr>"
        yield "</tbody>\n</table>"
        if cut and more > 0:
            yield _not_printed(f"The rest of this table ({more} more rows)")


def _is_number(cells: Sequence[str]) -> bool:
    """Return whether the cells of a column are numbers, or ranges, to be set right-aligned."""
    return all(map(_NUMBER.fullmatch, cells))


def asked_about(preamble: str, legend: Mapping[str, Any] | None) -> Iterator[str]:
    """Return the text that stood before the questions, and what the levels mean."""
    if preamble:
        yield f"<p>{escaped(preamble)}</p>"
    if legend is None:
        return
    if legend["duration"]:
        yield f"<p>{escaped(legend['duration'])}</p>"
    if any(level["meaning"] for level in legend["levels"]):
        rows = "".join(
            f'<tr><th scope="row">{escaped(one["label"])}</th>'
            f"<td>{escaped(one['meaning'])}</td></tr>"
            for one in legend["levels"]
        )
        yield f'<table class="levels"><tbody>{rows}</tbody></table>'


def escaped(words: object) -> str:
    """Return text with HTML's special characters escaped."""
    return escape(str(words))


def counted(counts: Mapping[str, int]) -> str:
    """Return sentences on the numbers of answers of each kind, and how repeats were answered."""
    found = Counts.read(counts)
    return f"{found.sentence} {found.checks}".strip()


def about_scale(rows: Sequence[Mapping[str, Any]], certainty: str) -> str:
    """Return sentences on what the values of the levels mean; ``rows`` are best first."""
    best, worst = rows[0]["label"], rows[-1]["label"]
    bars = "Bar: range"
    if _has_given(rows):
        bars = "Thick bar: range if no answer is a mistake. Thin bar: range allowing for mistakes"
    return (
        f"From 0 (“{worst}”) to 100 (“{best}”). A level at 60 is as good to you as 60 of 100 at "
        f"“{best}” and 40 at “{worst}”. Dot: best guess. {bars} "
        f"({certainty})."
    )


def _has_given(rows: Sequence[Mapping[str, Any]]) -> bool:
    """Return whether the range if no answer is a mistake is less than the whole one somewhere."""
    return any(is_narrower(row.get("given"), row["low"], row["high"]) for row in rows)


def _scale(
    rows: Sequence[Mapping[str, Any]], certainty: str, notes: Sequence[str]
) -> Iterator[str]:
    yield f'<table class="scale">\n<caption>{escaped(about_scale(rows, certainty))}</caption>'
    marks = "".join(f'<text x="{x}%" y="14" text-anchor="middle">{x}</text>' for x in (0, 50, 100))
    axis = f'<svg height="18" font-size="13" fill="#4a5864" aria-hidden="true">{marks}</svg>'
    yield f'<thead><tr><th scope="col">Level</th><td class="drawn">{axis}</td>'
    heads = {"guess": "Best guess", "given": IF_NO_MISTAKE, "range": _WITH_MISTAKES}
    if not (has_given := _has_given(rows)):
        heads = {"guess": "Best guess", "range": "Range"}
    for kind, words in heads.items():
        yield f'<th scope="col" class="number {kind}">{words}</th>'
    yield "</tr></thead>\n<tbody>"
    for i, row in enumerate(rows):
        low, high = row["low"], row["high"]
        between = FIXED if low == high else _between_ends(low, high)
        known = row.get("known", True)
        shade = colour_of(1.0 - i / max(1, len(rows) - 1))
        colour = shade if known else None
        rough = row.get("rough", False)
        given = row.get("given")
        picture = interval_picture(low, row["value"], high, colour, rough, given, shade)
        guess = guess_in_words(row["value"], known, rough)
        cells = {"guess": guess, "given": _between_ends(*given) if given else "", "range": between}
        if not has_given:
            del cells["given"]
        yield f'<tr><th scope="row">{escaped(row["label"])}</th><td class="drawn">{picture}</td>'
        for kind, words in cells.items():
            head = "" if words == FIXED else heads[kind]
            fixed = " fixed" if words == FIXED else ""
            yield f'<td class="number {kind}{fixed}" data-head="{head}">{words}</td>'
        yield "</tr>"
    # a narrow page has the axis here, for there the heads stand right above the numbers
    yield f'</tbody>\n<tfoot><tr class="axis"><td class="drawn">{axis}</td></tr></tfoot>\n</table>'
    if notes:
        yield f'<p class="soft">{escaped(" ".join(notes))}</p>'


def _between_ends(low: float, high: float) -> str:
    return f"{low:.0f} to {high:.0f}"


def interval_picture(
    low: float,
    value: float,
    high: float,
    colour: str | None,
    rough: bool = False,
    given: Sequence[float] | None = None,
    shade: str = "",
) -> str:
    """Return a picture of a level's interval on the scale from 0 to 100, as HTML.

    A filled bar has a dot at the best guess. If ``colour``, as from ``colour_of``, is None the bar
    is hollow, without a dot, or with a hollow one if ``rough``. It is in the middle of the picture,
    however high the style makes that. ``given``, the low and the high end of a narrower range, is a
    thick bar filled with ``shade``; the other one is then thin.
    """
    grid = "".join(
        f'<line x1="{x}%" x2="{x}%" y1="0" y2="100%" stroke="#e4e9ee"/>'
        for x in (0, 25, 50, 75, 100)
    )
    fill = 'fill="none"' if colour is None else f'class="level" style="{colour}"'
    dashed = ' stroke-dasharray="4 3"' if colour is None else ""
    given = given if is_narrower(given, low, high) else None
    dot = (
        f'<circle cx="{value:.2f}%" cy="50%" r="4.5" fill="#14202b" stroke="#fff" '
        'stroke-width="1"/>'
    )
    if colour is None:
        dot = (
            f'<circle class="rough" cx="{value:.2f}%" cy="50%" r="4" '
            f'fill="{"none" if given is None else "#fff"}" stroke="#33414d" stroke-width="2"/>'
        )
    if low == high:
        dot = f'<circle cx="{value:.2f}%" cy="50%" r="6" {fill} stroke="#33414d"/>'
    high_bar, half = (14, 7) if given is None else (6, 3)
    bars = (
        f'<rect x="{low}%" width="{high - low}%" y="50%" transform="translate(0 -{half})" '
        f'height="{high_bar}" rx="{half // 2}" {fill} stroke="#33414d"{dashed}/>'
    )
    if given is not None:
        start, end = given
        bars += (
            f'<rect class="level" style="{shade}" x="{start}%" width="{end - start}%" y="50%" '
            f'transform="translate(0 -8)" height="16" rx="3" stroke="#33414d"/>'
        )
    return (
        f'<svg height="34" aria-hidden="true">{grid}{bars}'
        f"{dot if colour is not None or rough else ''}</svg>"
    )


def colour_of(share: float) -> str:
    """Return the colours of a level on a light and on a dark page, as two properties of a style.

    ``share`` is from 0 for the worst level to 1 for the best.
    """
    return "; ".join(f"--{page}: {_between(colours, share)}" for page, colours in COLOURS.items())


def _between(colours: Sequence[tuple[int, int, int]], share: float) -> str:
    at = share * (len(colours) - 1)
    low = min(int(at), len(colours) - 2)
    pairs = zip(colours[low], colours[low + 1], strict=True)
    return f"rgb({','.join(str(round(a + (at - low) * (b - a))) for a, b in pairs)})"


def _statements(lines: Iterable[str]) -> Iterator[str]:
    """Return lines as paragraphs. Indented lines become a list under the line before."""
    within = False
    for line in lines:
        item = line.startswith("  ")
        if item != within:
            yield "<ul>" if item else "</ul>"
        yield f"<li>{escaped(line.strip())}</li>" if item else f"<p>{escaped(line)}</p>"
        within = item
    if within:
        yield "</ul>"


def conflict_box(entries: Sequence[Mapping[str, Any]]) -> str:
    """Return a box with answers that contradict each other, as HTML."""
    items = "".join(f"<li>{escaped(entry['sentence'])}</li>" for entry in entries)
    said = (
        f"These {len(entries)} answers contradict each other. Taking back any one of them fixes it."
    )
    if len(entries) == 1:
        said = "This answer goes against the order of the levels."
    return f'<div class="conflict"><p>{said}</p><ul>{items}</ul></div>'


def _answers(answers: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    columns = {"nr": "#", "answer": "Answer", "when": "When (UTC)", "remarks": "Remarks"}
    head = "".join(
        f'<th scope="col" class="{name}">{words}</th>' for name, words in columns.items()
    )
    yield f'<table class="answers">\n<thead><tr>{head}</tr></thead>\n<tbody>'
    for one in answers:
        sentence = escaped(one["sentence"])
        said = sentence if one["stands"] else f"<s>{sentence}</s>"
        if one.get("shown"):
            said += f'<br><span class="soft shown">{escaped(one["shown"])}</span>'
        when = escaped((one["time"] or "")[:16].replace("T", " "))
        noted = escaped("; ".join(one["remarks"]))
        yield (
            f"<tr><td>{one['number']}</td><td>{said}</td>"
            f'<td class="soft">{when}</td><td>{noted}</td></tr>'
        )
    yield "</tbody>\n</table>"
