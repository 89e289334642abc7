"""Sentences of prose, in pages of docs/ and of the report, and how many numbers they have."""

import html
import re

#: What is no prose: code, generated tables, rows, headings, lists of options; and a section whose
#: numbers are the bars of its table.
NO_PROSE = re.compile(
    r"^```.*?^```$|<!-- table: .*?<!-- end -->|^## How good it is$.*?(?=^## )"
    r"|^(?:\||#+ |- Options:)[^\n]*$",
    re.DOTALL | re.MULTILINE,
)
#: What is no number to read: comments, code, targets of links.
UNREAD = re.compile(r"<!--.*?-->|`[^`]*`|\]\([^)]*\)", re.DOTALL)
PARAGRAPH = re.compile(r"\n\s*\n|^\s*(?:[-*]|\d+\.) ", re.MULTILINE)
SENTENCE = re.compile(r"(?<=[.!?])[)*\"']*\s+(?=[A-Z_*`\[(“\"])")
IN_WORDS = re.compile(r"(?<![\w.])\.?\d[\d,]*(?:\.\d+)?")
MOST_NUMBERS = 4  #: that a sentence may have
#: Elements of prose on a page of the report.
ELEMENT = re.compile(
    r"<(p|li|figcaption|dd)\b(?! id=\"words-)[^>]*>(.*?)</\1>|<caption><div>(.*?)</div>", re.DOTALL
)


def crowded(text: str) -> list[str]:
    """The sentences of a page's prose with too many numbers."""
    prose = UNREAD.sub(" _ ", NO_PROSE.sub("\n\n", text))
    sentences = [
        sentence
        for paragraph in PARAGRAPH.split(prose)
        for sentence in SENTENCE.split(" ".join(paragraph.split()))
    ]
    return [one for one in sentences if len(IN_WORDS.findall(one)) > MOST_NUMBERS]


def prose_of(html_text: str) -> str:
    """The prose of a page, a paragraph for each element; without code, formulas, drawings."""
    unread = r"<(script|style|svg|code|sub)\b.*?</\1>"
    shown = re.sub(unread, "", html_text, flags=re.DOTALL)
    parts = [found[2] or found[3] or "" for found in ELEMENT.finditer(shown)]
    return "\n\n".join(html.unescape(re.sub(r"<[^>]+>", "", part)) for part in parts)
