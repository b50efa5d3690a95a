"""The site, made from the root of the repository by ``make docs``: so a link leads to the same page
here and there.

Docstrings are plain text with ``code``, and parameters in numpydoc's sections or in two columns:
``as_rst`` says so to Sphinx.
"""

import json
import re
from functools import partial
from html import escape
from importlib.metadata import version as version_of
from typing import Any

from myst_parser.parsers.sphinx_ import MystParser

project = "elicit + qlearn"
copyright = "2026, the elicit + qlearn authors"
version = release = version_of("elicit-qlearn")

extensions = ["myst_parser", "sphinx.ext.autodoc"]
root_doc = "docs/index"
include_patterns = [
    "docs/**.md",
    "benchmarks/*.md",
    "notebooks/*.ipynb",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
]
exclude_patterns = [
    ".venv",
    ".git",
    ".*_cache",
    ".hypothesis",
    "build",
    "dist",
    "results",
    "tests",
]
source_suffix = {".md": "markdown", ".ipynb": "notebook"}
myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 3

html_theme = "pydata_sphinx_theme"
html_title = project
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_additional_pages = {"index": "start.html"}  # the root leads to docs/index.html
templates_path = ["_templates"]
html_sidebars = {"**": ["pages.html"]}
html_show_sourcelink = False
html_theme_options = {
    "navbar_center": [],
    "navbar_persistent": [],
    "navbar_end": ["search-field", "theme-switcher"],
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
}

autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_default_options = {"members": True}
_ALIASES = ("ArrayLike", "EarlierAnswers", "Floats", "Seed", "Strategy", "Verdicts")
autodoc_type_aliases = {name: name for name in _ALIASES}
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 100
toc_object_entries_show_parents = "hide"

_CODE = re.compile(r"(``.+?``)", re.DOTALL)
_COLUMNS = re.compile(r"(\S(?:.*?\S)?) {2,}(?=\S)")


def as_rst(lines: list[str]) -> list[str]:
    """Return a docstring's lines as reStructuredText: text that is no ``code`` means itself.

    Numpydoc's sections, and parameters in one column with their meaning in another, become lists of
    definitions."""
    out: list[str] = []
    in_section = False
    for paragraph in "\n".join(lines).strip("\n").split("\n\n"):
        rows = paragraph.split("\n")
        if len(rows) > 1 and set(rows[1]) == {"-"}:
            out += [f".. rubric:: {rows[0]}", ""]
            in_section = rows[0] != "Notes"  # which is prose
            rows = rows[2:]
        if not rows:
            continue
        set_in = [row.startswith("    ") for row in rows]
        if in_section and any(set_in):
            out += _definitions(rows)
            continue
        if all(set_in):  # an example
            out += ["::", "", *rows, ""]
            continue
        first = _COLUMNS.match(rows[0])
        width = first.end() if first else 0
        if width and all(
            row[:width].rstrip() != row[:width] and row[width:].strip() for row in rows
        ):
            for row in rows:
                if name := row[:width].strip():
                    out.append(f"``{name}``")
                out.append("    " + _plain(row[width:]))
        else:
            out += _plain("\n".join(rows)).split("\n")
        out.append("")
    return out


def _definitions(rows: list[str]) -> list[str]:
    """Return names, and the text set in below each, as a list of definitions; a name without text
    is a paragraph.
    """
    out: list[str] = []
    for i, row in enumerate(rows):
        if row.startswith("    "):
            out.append(f"    {_plain(row.strip())}")
        else:
            out += ["", f"``{row}``"]
            if not rows[i + 1 : i + 2] or not rows[i + 1].startswith("    "):
                out.append("")
    return [*out, ""]


def _plain(text: str) -> str:
    parts = _CODE.split(text)
    return "".join(
        part if part.startswith("``") else re.sub(r"([\\*|`]|_(?=\W|$))", r"\\\1", part)
        for part in parts
    )


_WHERE = r"~?(?:\w+\.)*"  # the module of a name
_ARRAY = rf"{_WHERE}ndarray\[tuple\[{_WHERE}Any, \.\.\.\], {_WHERE}dtype\[{_WHERE}"
# what Sphinx makes of aliases within other types, and of types that are no text where they stand
_LONG = {
    rf"{_WHERE}TypeAliasForwardRef\('(\w+)'\)": r"\1",
    rf"{_WHERE}_Buffer \| [^=]*?{_WHERE}_NestedSequence\[complex \| bytes \| str\]": "ArrayLike",
    rf"{_ARRAY}float64\]\]": "Floats",
    rf"{_ARRAY}(\w+)(?:\[{_WHERE}Any\])?\]\]": r"NDArray[\1]",
}


def shortened(signature: str | None) -> str | None:
    """A signature, or what is returned, with the aliases' names in place of what they stand for."""
    for long, short in _LONG.items():
        signature = signature and re.sub(long, short, signature)
    return signature


class NotebookParser(MystParser):
    """Reads a notebook as committed: its text, its code, and what its cells showed."""

    supported = ("notebook",)

    def parse(self, inputstring: str, document: Any) -> None:
        super().parse(as_markdown(json.loads(inputstring)), document)


def as_markdown(notebook: dict[str, Any]) -> str:
    """A notebook as one page of Markdown. The text before a picture stands in for it (alt).

    For the picture that the opening shows, this is the opening's own text for it.
    """
    parts, before = [], ""
    opening = _ATTACHED.search("".join(notebook["cells"][0]["source"]))
    for cell in notebook["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            before = _described(source)
            text = _MATH.sub(_as_code, source)
            parts.append(_ATTACHED.sub(partial(_attached, cell), text))
        elif source:
            parts.append(f"```python\n{source}\n```")
            tags = cell["metadata"].get("tags", ())
            alt = opening[1] if opening and "picture" in tags else before
            shown = (_shown(output, alt) for output in cell["outputs"])
            parts += [each for each in shown if each]
    return "\n\n".join(parts)


_MATH = re.compile(r"\$\$?([^$]+?)\$\$?")
_ATTACHED = re.compile(r"!\[([^\]]*)\]\(attachment:([^)]+)\)")
_LONGEST = 300  # characters of the text that stands in for a picture


def _as_code(formula: re.Match[str]) -> str:
    """A formula of TeX as code, which needs no script to be read."""
    text = formula[1].replace(r"\,", " ").replace(r"\cdot", ".")
    return f"`{text}`"


def _attached(cell: dict[str, Any], found: re.Match[str]) -> str:
    """A picture that is attached to a cell of text."""
    return _picture(cell["attachments"][found[2]]["image/png"], found[1])


def _picture(data: str, alt: str) -> str:
    code = data.replace("\n", "")
    return f'<p><img alt="{escape(alt)}" src="data:image/png;base64,{code}"></p>'


def _described(text: str) -> str:
    """The heading of a text and the beginning of its last paragraph, as plain text."""
    *others, last = re.split(r"\n\s*\n", text.strip())
    headings = [part for part in others if part.startswith("#")]
    plain = re.sub(r"!?\[([^\]]*)\]\([^)]*\)|[*`$#]|^- ", r"\1", last, flags=re.MULTILINE)
    said = ""
    for sentence in re.split(r"(?<=[.:?!])\s+", re.sub(r"\s+", " ", plain)):
        if said and len(f"{said} {sentence}") > _LONGEST:
            break
        said = f"{said} {sentence}".strip()
    if not headings:
        return said
    heading = re.sub(r"^#+ (\d+\. )?", "", headings[-1])
    return f"{heading}{'' if heading.endswith(('.', '?', '!')) else '.'} {said}"


def _shown(output: dict[str, Any], alt: str) -> str:
    """An output of a cell as Markdown: a picture or a table before plain text."""
    data = {kind: "".join(value) for kind, value in output.get("data", {}).items()}
    data.setdefault("text/plain", "".join(output.get("text", "")))
    if "image/png" in data:
        return _picture(data["image/png"], alt)
    if "text/html" in data:  # a blank line would end it
        return "\n".join(line for line in data["text/html"].splitlines() if line.strip())
    if "text/markdown" in data:
        return data["text/markdown"]
    text = data["text/plain"].rstrip()
    return f"```text\n{text}\n```" if text else ""


def setup(app: Any) -> None:
    app.add_source_parser(NotebookParser)

    def process(app: Any, what: str, name: str, found: Any, options: Any, lines: list[str]) -> None:
        lines[:] = as_rst(lines)

    def skip(
        app: Any, what: str, name: str, found: Any, skipped: bool, options: Any
    ) -> bool | None:
        return (
            True
            if str(getattr(found, "__doc__", "")).startswith("Alias for field number")
            else None
        )

    def leave_out(app: Any, doctree: Any) -> None:
        """Pages of results are listed in docs/evidence.md, not in the navigation."""
        if app.env.docname.startswith("benchmarks/RESULTS"):
            app.env.metadata[app.env.docname]["orphan"] = True

    def shorten(*found: Any) -> tuple[str | None, str | None]:
        signature, returned = found[-2:]
        return shortened(signature), shortened(returned)

    app.connect("doctree-read", leave_out)
    app.connect("autodoc-process-docstring", process)
    app.connect("autodoc-process-signature", shorten)
    app.connect("autodoc-skip-member", skip)
