"""Sentences of prose, in pages of docs/ and of the report, and how many numbers they have."""

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


def crowded(text: str) -> list[str]:
    """The sentences of a page's prose with too many numbers."""
    prose = UNREAD.sub(" _ ", NO_PROSE.sub("\n\n", text))
    sentences = [
        sentence
        for paragraph in PARAGRAPH.split(prose)
        for sentence in SENTENCE.split(" ".join(paragraph.split()))
    ]
    return [one for one in sentences if len(IN_WORDS.findall(one)) > MOST_NUMBERS]
