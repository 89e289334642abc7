"""Random changes of small valid files: of bytes, lines, fields, JSON values,
or columns of a Parquet table.
"""

import codecs
import gzip
import io
import json
import re
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import product
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
from hypothesis import strategies as st
from hypothesis.strategies import DrawFn, SearchStrategy

from tools.fuzz.formats import Files

GZIP = b"\x1f\x8b"
#: Placeholders for JSON text that no Python value gives; the text replaces them when the file is
#: written.
RAW = {
    "@deep": "[" * 1_000 + "]" * 1_000,
    "@deeper": "[" * 200_000 + "]" * 200_000,
    "@deepest": '{"a":' * 1_000_000 + "1" + "}" * 1_000_000,
    "@digits": "9" * 5_000,
}
TEXTS = [
    "", " ", "false", "None", "NaN", "x" * 10_000, "a\x00b", "a\nb", "\x1b[2J", "../../x",
    "\u202eabc", "é", "|", "#", "\ufeff", "mug", "Mug|1", "kitchen", "object",
]  # fmt: skip
NUMBERS = [-1, 0, 1, 2, 255, 2**31, 3_000_000_000, 1e308, -1e308, 1e-320, 0.5]
NUMBERS += [float("nan"), float("inf")]
NESTED: list[Any] = [[], {}, [[]], [None], {"a": 1}]
ODD_VALUES = [None, True, False, *TEXTS, *NUMBERS, *NESTED, "\ud800", 10**20, *RAW]
ODD_FIELDS = [str(value).encode() for value in [*TEXTS, *NUMBERS]]
ODD_FIELDS += [
    b"00", b"2147483647", b"9" * 20, b"9" * 5_000, b"1e17", b"-1e17", b"1_0", b"\xe9",
    b"\xed\xa0\x80", b'"', b'"a', b"?", b"<urn:x:a>", b"_:b", b'"lit"@en',
]  # fmt: skip
ODD_FIELDS += [b",", b"\t", b" x", b",x", b",,"]
ODD_LINES = [b"\n", b" \n", b"\r\n", b"#\n", b"x" * 3_000_000]
ODD_BYTES = [*map(str.encode, '\x00\n\r\t,"{'), b"[" * 3_000, b"9" * 30]
ODD_BYTES += [bytes([number]) for number in range(256)]
ODD_NAMES = ["", "x", "head", "count", "n" * 10_000, "a\nb", "weight", "e1", "tailLabel"]
ODD_COLUMNS = [pa.array([value]) for value in [None, True, b"\xff", 2**62, *TEXTS, *NUMBERS]]
ODD_COLUMNS += [pa.array([["a"]]), pa.array([{"a": 1}]), pa.array([0], pa.timestamp("s"))]
ODD_COLUMNS += [pa.array(["mug"]).dictionary_encode()]


@st.composite
def changed(draw: DrawFn, files: Files) -> Files:
    """The files with one or more changes in one of them."""
    name = draw(st.sampled_from(sorted(files)))
    content = files[name]
    packed = content.startswith(GZIP) and draw(st.integers(0, 4)) > 0
    content = gzip.decompress(content) if packed else content
    for _ in range(draw(st.sampled_from([1, 1, 1, 2, 3]))):
        way = draw(st.sampled_from(ways(name, content)))
        content = draw(way(content))
    return files | {name: gzip.compress(content, mtime=0) if packed else content}


def ways(name: str, content: bytes) -> list[Callable[[bytes], SearchStrategy[bytes]]]:
    """Strategies that change a file; those that keep its syntax are listed repeatedly,
    to be chosen more often.
    """
    if content.startswith(b"PAR1") and content.endswith(b"PAR1"):
        return [of_form, of_bytes, *[of_columns] * 6]
    if name.endswith((".bin", ".safetensors")):
        return [of_form, *[of_bytes] * 4, *[of_lines] * 2]
    kept = of_json if ".json" in name else of_fields
    return [of_form, *[of_bytes] * 2, *[of_lines] * 2, *[kept] * 6]


@st.composite
def of_form(draw: DrawFn, content: bytes) -> bytes:
    """Another form of all bytes: none, compressed, reversed, or in another encoding."""
    text, codes = content.decode("latin-1"), ("utf-16", "utf-16-le", "utf-32", "utf-8")
    forms = [b"", b"\n", codecs.BOM_UTF8 + content, gzip.compress(content), content[::-1]]
    forms += [content.replace(b"\n", b"\r\n"), *map(text.encode, codes)]
    return draw(st.sampled_from(forms))


@st.composite
def spliced(draw: DrawFn, parts: list[Any], odd: Sequence[Any]) -> list[Any]:
    """Parts with other ones at a place: none, an odd one, or some of their own."""
    start, first, last = (draw(st.integers(0, len(parts))) for _ in range(3))
    stop = start + draw(st.sampled_from([0, 1, 1, 2, 40, len(parts)]))
    copied = draw(st.sampled_from([[], parts[first:last], None, None]))
    new = [draw(st.sampled_from(odd))] if copied is None else copied
    return [*parts[:start], *new, *parts[stop:]]


@st.composite
def of_parts(draw: DrawFn, content: bytes, pattern: bytes, odd: Sequence[bytes]) -> bytes:
    """Change parts of a text, which ``pattern`` matches."""
    return b"".join(draw(spliced(re.findall(pattern, content), odd)))


of_bytes = partial(of_parts, pattern=rb"(?s).", odd=ODD_BYTES)
of_lines = partial(of_parts, pattern=rb".*\n|.+", odd=ODD_LINES)
of_fields = partial(of_parts, pattern=rb"[,\t \n]+|[^,\t \n]+", odd=ODD_FIELDS)


@st.composite
def of_json(draw: DrawFn, content: bytes) -> bytes:
    """Change a value of a JSON file, or of a line of JSON Lines:
    replace, remove, double, rename or move it.
    """
    is_whole = content.startswith((b"[\n", b"{\n"))
    lines = [content] if is_whole else content.split(b"\n")
    here = draw(st.integers(0, len(lines) - 1))
    try:
        tree = [json.loads(lines[here])]
    except (ValueError, RecursionError):  # changed before
        return draw(of_bytes(content))
    spots = list(spots_of(tree))
    (holder, key), (other, place) = (draw(st.sampled_from(spots)) for _ in range(2))
    way = draw(st.integers(0, 9))
    if way <= 4 or tree is holder:
        holder[key] = draw(st.sampled_from(ODD_VALUES))
    elif way == 5:
        del holder[key]
    elif way <= 7:
        holder[key] = json.loads(json.dumps(other[place]))
    elif isinstance(holder, list):
        holder.insert(key, holder[key])
    else:
        holder[draw(st.sampled_from(TEXTS))] = holder.pop(key)
    text = json.dumps(tree[0])
    for name, raw in RAW.items():
        text = text.replace(f'"{name}"', raw)
    lines[here] = text.encode()
    return b"\n".join(lines)


def spots_of(tree: Any) -> Iterator[tuple[Any, Any]]:
    """Lists and mappings within a value, each with its indices or keys."""
    for key, value in enumerate(tree) if isinstance(tree, list) else tree.items():
        yield tree, key
        if isinstance(value, list | dict):
            yield from spots_of(value)


@st.composite
def of_columns(draw: DrawFn, content: bytes) -> bytes:
    """Change a Parquet table: replace, rename, remove or double columns; double or remove rows;
    change a value.
    """
    try:
        table = pq.read_table(io.BytesIO(content))
    except (pa.ArrowException, OSError):  # changed before
        return draw(of_bytes(content))
    columns, rows = list(zip(table.column_names, table.columns, strict=True)), table.num_rows
    way = draw(st.integers(0, 5))
    if way == 0 or not columns or not rows:
        table = pa.concat_tables([table] * 2) if draw(st.booleans()) else table.slice(0, 0)
    elif way <= 2:
        columns = draw(spliced(columns, list(product(ODD_NAMES, table.columns))))
        table = pa.table([values for _, values in columns], [name for name, _ in columns])
    else:
        place, row = (draw(st.integers(0, number - 1)) for number in (len(columns), rows))
        new, column = draw(st.sampled_from(ODD_COLUMNS)), table.column(place).combine_chunks()
        try:  # one value of the column if its type fits, else all values
            parts = [column.slice(0, row), new.cast(column.type), column.slice(row + 1)]
            values = pa.concat_arrays(parts)
        except pa.ArrowException:
            values = pa.concat_arrays([new] * rows)
        table = table.set_column(place, table.column_names[place], values)
    out = io.BytesIO()
    pq.write_table(table, out)
    return out.getvalue()
