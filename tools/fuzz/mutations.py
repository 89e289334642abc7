"""Random changes of small valid files: of bytes, lines, fields, JSON values,
or columns of a Parquet table.
"""

import codecs
import gzip
import io
import json
import re
from collections.abc import Callable
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
from hypothesis import strategies as st
from hypothesis.strategies import DrawFn, SearchStrategy

Files = dict[str, bytes]
GZIP = b"\x1f\x8b"
#: Placeholders for JSON text that no Python value gives; the text replaces them when the file is
#: written.
RAW = {
    "@deep": "[" * 1_000 + "]" * 1_000,
    "@deeper": "[" * 200_000 + "]" * 200_000,
    "@deepest": '{"a":' * 1_000_000 + "1" + "}" * 1_000_000,
    "@digits": "9" * 5_000,
}
ODD_TEXT = [
    "", " ", "false", "None", "NaN", "x" * 10_000, "\ud800", "a\x00b", "a\nb", "\x1b[2J", "../../x",
    "\u202eabc", "é", "|", "#", "\ufeff", "mug", "Mug|1", "kitchen", "object",
]  # fmt: skip
ODD: list[Any] = [
    None, True, False, *ODD_TEXT, -1, 0, 1, 2, 255, 2**31, 3_000_000_000, 10**20, 1e308, -1e308,
    1e-320, float("nan"), float("inf"), 0.5, [], {}, [[]], [None], {"a": 1}, *RAW,
]  # fmt: skip
ODD_FIELDS = [
    b"", b" ", b"-1", b"0", b"00", b"1.5", b"2147483647", b"2147483648", b"3000000000", b"9" * 20,
    b"9" * 5_000, b"1e308", b"1e17", b"-1e17", b"NaN", b"inf", b"-inf", b"1_0", b"false",
    b"x" * 10_000, b"\xe9", b"\x00", b"\xed\xa0\x80", b'"', b'"a', b"../x", b"\x1b[2J",
    b"\xef\xbb\xbf", b"?", b"<urn:x:a>", b"_:b", b'"lit"@en', b"mug", b"kitchen",
]  # fmt: skip
ODD_BYTES = [
    b"\x00",
    b"\xff",
    b"\xef\xbb\xbf",
    b"\n",
    b"\r",
    b"\t",
    b",",
    b'"',
    b"{",
    b"[" * 3_000,
    b"\xed\xa0\x80",
    b"9" * 30,
]


@st.composite
def changed(draw: DrawFn, files: Files) -> Files:
    """The files with one or more changes in one of them."""
    name = draw(st.sampled_from(sorted(files)))
    content = files[name]
    packed = content.startswith(GZIP) and draw(st.integers(0, 4)) > 0
    content = gzip.decompress(content) if packed else content
    for _ in range(draw(st.sampled_from([1, 1, 1, 2, 3]))):
        content = draw(draw(st.sampled_from(_ways(name, content)))(content))
    return files | {name: gzip.compress(content, mtime=0) if packed else content}


def _ways(name: str, content: bytes) -> list[Callable[[bytes], SearchStrategy[bytes]]]:
    """Strategies that change a file; those that keep its syntax are listed repeatedly,
    to be chosen more often.
    """
    if content.startswith(b"PAR1") and content.endswith(b"PAR1"):
        return [of_bytes, of_columns, of_columns, of_columns]
    if name.endswith((".bin", ".safetensors")):
        return [of_bytes, of_bytes, of_lines]
    if ".json" in name:
        return [of_bytes, of_lines, of_json, of_json, of_json, of_json, of_json]
    return [of_bytes, of_lines, of_fields, of_fields, of_fields]


@st.composite
def of_bytes(draw: DrawFn, content: bytes) -> bytes:
    """Change bytes: cut, flip, insert, swap, double, re-encode or remove all."""
    first, last = sorted(draw(st.integers(0, len(content))) for _ in range(2))
    near = min(last, first + draw(st.integers(1, 40)))
    way = draw(st.integers(0, 9))
    if way == 0:
        return content[:first]
    if way == 1:
        return content[:first] + content[near:]
    if way in (2, 3) and first < len(content):
        return (
            content[:first]
            + bytes([content[first] ^ 1 << draw(st.integers(0, 7))])
            + content[first + 1 :]
        )
    if way in (4, 5):
        return (
            content[:first]
            + draw(st.sampled_from(ODD_BYTES))
            + content[near if way == 5 else first :]
        )
    if way == 6:
        return content[:first] + content[last:] + content[first:last]
    if way == 7:
        return content[:last] + content[first:last] + content[last:]
    if way == 8:
        return draw(
            st.sampled_from(
                [b"", b"\n", codecs.BOM_UTF8 + content, gzip.compress(content), content[::-1]]
            )
        )
    return content.decode("latin-1").encode(
        draw(st.sampled_from(["utf-16", "utf-16-le", "utf-32", "utf-8"]))
    )


@st.composite
def of_lines(draw: DrawFn, content: bytes) -> bytes:
    """Change a line: remove, double, move or blank it, or remove its end."""
    lines = content.split(b"\n")
    here, there = (draw(st.integers(0, len(lines) - 1)) for _ in range(2))
    way = draw(st.integers(0, 5))
    if way == 0:
        del lines[here]
    elif way == 1:
        lines.insert(there, lines[here])
    elif way == 2:
        lines[here], lines[there] = lines[there], lines[here]
    elif way == 3:
        lines[here] = lines[here][: draw(st.integers(0, len(lines[here])))]
    elif way == 4:
        lines[here] = draw(st.sampled_from([b"", b" ", b"\r", b"#", b"x" * 3_000_000]))
    else:
        lines = [line + b"\r" for line in lines]
    return b"\n".join(lines)


@st.composite
def of_fields(draw: DrawFn, content: bytes) -> bytes:
    """Change a field of a line: replace, remove, double or swap it;
    or append a field to some lines.
    """
    lines = content.split(b"\n")
    here = draw(st.integers(0, len(lines) - 1))
    fields = re.split(rb"([,\t ]+)", lines[here])
    place, other = (draw(st.integers(0, (len(fields) - 1) // 2)) * 2 for _ in range(2))
    way = draw(st.integers(0, 6))
    if way <= 2:
        fields[place] = draw(st.sampled_from(ODD_FIELDS))
    elif way == 3:
        del fields[place : place + 2]
    elif way == 4:
        fields[place], fields[other] = fields[other], fields[place]
    elif way == 5:
        fields.append(draw(st.sampled_from([b",", b"\t", b" x", b",x", b",,"])))
    else:
        return b"\n".join(line + b"," if line else line for line in lines)
    lines[here] = b"".join(fields)
    return b"\n".join(lines)


@st.composite
def of_json(draw: DrawFn, content: bytes) -> bytes:
    """Change a value of a JSON file, or of a line of JSON Lines:
    replace, remove, double, rename or move it.
    """
    lines = (
        [content]
        if b"\n" not in content.strip() or content.startswith((b"[\n", b"{\n"))
        else content.split(b"\n")
    )
    here = draw(st.integers(0, len(lines) - 1))
    try:
        tree = [json.loads(lines[here])]
    except (ValueError, RecursionError):  # changed before
        return draw(of_bytes(content))
    spots = list(_spots(tree))
    holder, key = draw(st.sampled_from(spots))
    way = draw(st.integers(0, 9))
    if way <= 4 or tree is holder:
        holder[key] = draw(st.sampled_from(ODD))
    elif way == 5:
        del holder[key]
    elif way == 6 and isinstance(holder, list):
        holder.insert(key, holder[key])
    elif way <= 8:
        other, at = draw(st.sampled_from(spots))
        holder[key] = json.loads(json.dumps(other[at]))
    elif isinstance(holder, dict):
        holder[draw(st.sampled_from(ODD_TEXT))] = holder.pop(key)
    text = json.dumps(tree[0])
    for name, raw in RAW.items():
        text = text.replace(f'"{name}"', raw)
    lines[here] = text.encode()
    return b"\n".join(lines)


def _spots(tree: Any) -> Any:
    """Lists and mappings within a value, each with its indices or keys."""
    for key, value in enumerate(tree) if isinstance(tree, list) else tree.items():
        yield tree, key
        if isinstance(value, list | dict):
            yield from _spots(value)


ODD_COLUMNS = [
    pa.nulls(1),
    pa.array([None], pa.string()),
    pa.array([""]),
    pa.array([" "]),
    pa.array(["x" * 10_000]),
    pa.array([-1]),
    pa.array([0]),
    pa.array([2**31]),
    pa.array([2**62]),
    pa.array([1.5]),
    pa.array([float("nan")]),
    pa.array([True]),
    pa.array([b"\xff"]),
    pa.array([["a"]]),
    pa.array([{"a": 1}]),
    pa.array(["a\x00b"]),
    pa.array(["mug"]).dictionary_encode(),
    pa.array([0], pa.timestamp("s")),
    pa.array(["\u202eabc"]),
    pa.array(["kitchen"]),
]


#: Names of columns.
ODD_NAMES = ["", "x", "head", "count", "n" * 10_000, "a\nb", "weight", "e1", "tailLabel"]


@st.composite
def of_columns(draw: DrawFn, content: bytes) -> bytes:
    """Change a Parquet table: replace, rename, remove or double a column; double or remove rows;
    change a value.
    """
    try:
        table = pq.read_table(io.BytesIO(content))
    except (pa.ArrowException, OSError):  # changed before
        return draw(of_bytes(content))
    place = draw(st.integers(0, max(table.num_columns - 1, 0)))
    way = draw(st.integers(0, 7))
    if way == 0 or not table.num_columns or not table.num_rows:
        table = table.slice(0, 0)
    elif way == 1:
        table = pa.concat_tables([table, table])
    elif way == 2:
        table = table.remove_column(place)
    elif way == 3:
        names = list(table.column_names)
        names[place] = draw(st.sampled_from(ODD_NAMES))
        table = table.rename_columns(names)
    elif way == 4:
        table = table.append_column(table.column_names[place], table.column(place))
    else:
        odd = draw(st.sampled_from(ODD_COLUMNS))
        row = draw(st.integers(0, table.num_rows - 1))
        column = table.column(place).combine_chunks()
        try:  # one value of the column if its type fits, else all values
            values = pa.concat_arrays(
                [column.slice(0, row), odd.cast(column.type), column.slice(row + 1)]
            )
        except pa.ArrowException:
            values = pa.concat_arrays([odd] * table.num_rows)
        table = table.set_column(place, table.column_names[place], values)
    out = io.BytesIO()
    pq.write_table(table, out)
    return out.getvalue()
