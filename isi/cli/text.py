"""Answers of commands as text for people: each function renders the dictionary that ``--json`` prints."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

Answer = Mapping[str, Any]
#: What the share in front of a prediction is, by what it is calibrated on.
SHARES = {
    None: "percentile: share of the other entities that score lower",
    "held-out entities": "calibrated probability, on known entities that were held out and inserted the same way",
    "known triples": "calibrated probability, on known triples of the relation",
}
#: What was left out of an insertion.
LEFT_OUT = {"fact": "the triple {}", "words": "the words of {!r}", "indicator": "the indicator {}"}


def insertion(answer: Answer, top: int) -> Iterator[str]:
    """Of ``isi insert``."""
    weighted = _weighted(answer["indicators"])
    yield f"{answer['entity']}: inserted by {answer['initializer']} ({answer['why']})"
    if answer["fallback"]:
        yield f"  fell back to {answer['fallback']}: {answer['initializer']} needs what is not given"
    yield f"  insert triples: {len(answer['insert_triples'])}"
    yield from (f"  note: {note}" for note in answer["notes"])
    words = answer["words"]
    yield f"  words: a vector {words}" if words else f"  words: none ({answer['no_words']}); relations alone are used"
    yield from _indicators(answer["indicators"])
    yield f"predictions ({SHARES[answer['calibration']]})"
    for query in answer["answers"]:
        yield f"  {' '.join(query['query'])}"
        yield from _answers(query["answers"], [_note(one, weighted) for one in query["answers"]])
    if not answer["all_queries"]:
        yield "  (see isi ask for other relations)"
    yield f"unexpected predictions: {_unexpected(answer['unexpected'], weighted, top)}"
    yield f"nearest: {', '.join('{entity} ({cosine:.2f})'.format(**one) for one in answer['nearest'])}"
    farther = f"farther than {percent(answer['farther_than'])} of known entities"
    yield f"distance to the centroid: {answer['distance']:.2f} (1 is usual; {farther})"
    yield f"interference: {_interference(answer['interference'])}"


def ranking(answer: Answer) -> Iterator[str]:
    """Of ``isi ask``."""
    yield f"{' '.join(answer['query'])} ({SHARES[answer['calibration']]})"
    yield from _answers(answer["answers"], ["known" if one["known"] else "" for one in answer["answers"]])


def nearest(answer: Answer) -> Iterator[str]:
    """Of ``isi nearest``."""
    yield f"{answer['entity']} (cosine of the vectors)"
    yield from columns((f"{one['cosine']:.3f}", one["entity"], one["kind"] or "") for one in answer["nearest"])


def explanation(answer: Answer, top: int) -> Iterator[str]:
    """Of ``isi explain``."""
    yield f"{answer['entity']}: inserted by {answer['initializer']} ({answer['why']})"
    yield from (f"  insert triple: {' '.join(triple)}" for triple in answer["insert_triples"])
    if answer["definition"]:
        yield f"  definition: {answer['definition']}"
    yield from _indicators(answer["indicators"])
    yield f"without each of these (moved: distance over the length of its vector; the best {top} answers are compared)"
    for one in answer["without"]:
        what = LEFT_OUT[one["left_out"]].format(one["what"])
        if one["moved"] is None:
            yield f"  {what}: nothing is left to insert it by"
            continue
        other = f", by {one['initializer']}" * (one["initializer"] != answer["initializer"])
        yield f"  {what}: moved {one['moved']:.2f}, cosine {one['cosine']:.2f}{other}"
        for change in one["changes"]:
            replaced = f"{', '.join(change['added'])} instead of {', '.join(change['dropped'])}"
            yield f"    {' '.join(change['query'])}  {replaced}"
    if not answer["reproduced"]:
        yield "note: its vector has changed since the insertion: it was trained, or the word vectors are others"


def columns(rows: Iterable[Sequence[str]], indent: int = 2) -> Iterator[str]:
    """Lines of a table whose cells are as wide as their column; the last column is not filled."""
    cells = [list(row) for row in rows]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    for row in cells:
        filled = [cell.ljust(width) for cell, width in zip(row, widths, strict=True)]
        yield (" " * indent + "  ".join(filled)).rstrip()


def percent(share: float | None) -> str:
    """A share in per cent."""
    if share is None:
        return ""
    return "<1 %" if 0 < share < 0.005 else f"{100 * share:.0f} %"


def _answers(answers: Sequence[Answer], notes: Sequence[str]) -> Iterator[str]:
    """Ranked answers: probability or percentile, entity, note."""
    shares = [percent(one["percentile"] if one["probability"] is None else one["probability"]) for one in answers]
    yield from columns(
        ((f"{one['rank']:>3}", share.rjust(5), one["entity"], note)
         for one, share, note in zip(answers, shares, notes, strict=True)), indent=4,
    )  # fmt: skip


def _weighted(indicators: Sequence[Answer]) -> bool:
    return any(one["weight"] is not None for one in indicators)


def _indicators(indicators: Sequence[Answer]) -> Iterator[str]:
    """A table of indicators without its empty columns."""
    rows = [("indicator" if _weighted(indicators) else "most similar", "weight", "words", "relations")]
    for one in indicators:
        cosines = ("" if one[name] is None else f"{one[name]:.2f}" for name in ("words", "relations"))
        rows.append((one["entity"], percent(one["weight"]), *cosines))
    used = [number for number, column in enumerate(zip(*rows[1:], strict=True)) if any(column)]
    yield from columns([row[number] for number in used] for row in rows)


def _note(answer: Answer, weighted: bool) -> str:
    if answer["known"]:
        return "given"
    if answer["shared_by"]:
        first, *others = answer["shared_by"]
        return f"as {first}" + f" and {len(others)} more" * bool(others)
    if answer["shared_by"] is None:
        return ""
    return "no indicator has it" if weighted else "none of the most similar has it"


def _unexpected(triples: Sequence[Answer] | None, weighted: bool, top: int) -> str:
    if triples is None:
        return "unknown: the bundle has no known triples"
    texts = [
        " ".join(one["triple"]) + f" ({percent(one['probability'])})" * (one["probability"] is not None)
        for one in triples
    ]
    more = [f"and {len(texts) - top} more"] * (len(texts) > top)
    having = "an indicator" if weighted else "one of the most similar"
    return "; ".join(texts[:top] + more) or f"none: every likely answer was given, or {having} has it"


def _interference(measured: Answer | None) -> str:
    if measured is None:
        return "unknown: the bundle has no known triples"
    return (
        f"of {measured['queries']} queries about known triples it outranks the answer in"
        f" {100 * measured['above'][0]:.1f} %; their mean reciprocal rank was {measured['mrr_before']:.3f}"
        f" and is {measured['mrr_after']:.3f}"
    )
