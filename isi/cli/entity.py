"""Commands about entities of a bundle, one for each verb of ``LiveEmbedding``:
insert, observe, remove, undo, ask, ...

A command imports its modules when it runs, so that ``--help`` does not wait for PyTorch. An
``InputError`` refuses a broken bundle or an unknown name.
"""

from __future__ import annotations

import gc
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import asdict
from functools import partial
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from isi.cli import DEFAULT, FROM_ZERO, Embedding, Json, Out, Settings, Top, flags, settings, show
from isi.cli.output import refuse_inputs
from isi.config import check, read, value_of
from isi.errors import InputError, at
from isi.tables import paths

if TYPE_CHECKING:
    from isi.insertion.interference import Interference
    from isi.live.answers import Answer, Answers
    from isi.live.embedding import LiveEmbedding
    from isi.live.explain import Explanation, Report
    from isi.live.journal import Effect

FEW = 5  #: Queries, notes and indicators in a text, unless ``--verbose``.
LISTED = 20  #: Names of entities in a text.
Fact = Annotated[
    tuple[tuple[str, str, str], ...],
    Parameter(name="--fact", help="HEAD RELATION TAIL: a fact; may repeat"),
]
Verbose = Annotated[bool, Parameter(help="print all queries, notes and indicators")]
DryRun = Annotated[bool, Parameter(help="print the effect and write nothing")]
Source = Annotated[str | None, Parameter(help="what reported it, for the history")]


def insert(
    name: str | None = None,
    *,
    fact: Annotated[
        tuple[tuple[str, str], ...],
        Parameter(
            help="RELATION ENTITY: a fact about NAME; or all three parts, NAME first or last"
        ),
    ] = (),
    whole_fact: Annotated[tuple[tuple[str, str, str], ...], Parameter(show=False)] = (),
    inverse_fact: Annotated[
        tuple[tuple[str, str], ...], Parameter(help="ENTITY RELATION: a fact whose tail is NAME")
    ] = (),
    from_: Annotated[
        tuple[Path, ...],
        Parameter(
            name="--from", help="triples, scenes, ...: insert what is new, count what is known"
        ),
    ] = (),
    definition: Annotated[
        str | None, Parameter(help="definition in a sentence, for the word vector")
    ] = None,
    kind: Annotated[
        str | None, Parameter(help="default: the kind that the facts, else the words suggest")
    ] = None,
    new: Annotated[bool, Parameter(help="insert a name that looks like a known one")] = False,
    upsert: Annotated[
        bool, Parameter(help="if NAME is known already, add the facts alone")
    ] = False,
    initializer: Annotated[
        str | None, Parameter(help="default: the best for hidden known entities")
    ] = None,
    set: Annotated[Settings, Parameter(help="KEY=VALUE: an option of --initializer")] = (),
    vectors: Annotated[
        Path | None, Parameter(help="word2vec or GloVe file, for the vectors of all phrases")
    ] = None,
    seed: Annotated[int, Parameter(validator=FROM_ZERO, help="seed of a random initializer")] = 0,
    source: Source = None,
    out: Out = None,
    dry_run: DryRun = False,
    embedding: Embedding = DEFAULT,
    top: Top = 5,
    verbose: Verbose = False,
    json: Json = False,
) -> None:
    """Insert an entity, or what is new in files,
    and report what the embedding predicts about it.
    """
    if name is None and not from_ and len(whole_fact) == 1:  # --fact RELATION ENTITY NAME
        fact, name, whole_fact = (*fact, whole_fact[0][:2]), whole_fact[0][2], ()
    if (name is None) == (not from_) or (
        from_ and (fact or whole_fact or inverse_fact or definition or kind)
    ):
        raise InputError("", "", "expected either NAME with --fact RELATION ENTITY, or --from FILE")
    if set and initializer is None:
        raise InputError("--set", "", "expected an --initializer: --set gives its options")
    if out:
        refuse_inputs([out], [*from_, *filter(None, [vectors])])
    options = _options_in_params(initializer) | settings(set)
    request = {
        "initializer": initializer,
        "options": options,
        "seed": seed,
        "new": new,
        "source": source,
    }
    with (
        changing(embedding, out, dry_run, vectors, json) as live,
        flags(initializer="--initializer", options="--set"),
    ):
        if name is None:
            names, facts, kinds = _from_files(live, from_)
            request["new"] = True  # names in files are exact
            effect = live.insert(names, facts, kind=kinds, **request)  # type: ignore[arg-type]
            summary(live, effect, json)
        else:
            about = [(name, *pair) for pair in fact] + [(*pair, name) for pair in inverse_fact]
            about += [_about(name, whole) for whole in whole_fact]
            effect = live.insert(
                name,
                about,
                definition=definition,
                kind=kind,
                upsert=upsert,
                **request,  # type: ignore[arg-type]
            )
            if effect.inserted:
                report = live.report(name, top)
                show(asdict(report), True) if json else print(*in_words(report, verbose), sep="\n")
            else:
                summary(live, effect, json)


def observe(
    fact: Fact = (),
    *,
    new: Annotated[bool, Parameter(help="insert entities that are not known yet")] = False,
    source: Source = None,
    out: Out = None,
    dry_run: DryRun = False,
    embedding: Embedding = DEFAULT,
    json: Json = False,
) -> None:
    """Add facts of known or inserted entities;
    inserted ones get a new vector from all their facts.
    """
    with changing(embedding, out, dry_run, json=json) as live:
        summary(live, live.observe(list(fact), upsert=new, source=source), json)


def move(
    head: Annotated[str, Parameter(help="head of the fact")],
    relation: Annotated[str, Parameter(help="relation of the fact")],
    tail: Annotated[str, Parameter(help="its new tail")],
    *,
    instead_of: Annotated[
        str | None, Parameter(help="replace the fact with this tail alone; default: all")
    ] = None,
    source: Source = None,
    out: Out = None,
    dry_run: DryRun = False,
    embedding: Embedding = DEFAULT,
    json: Json = False,
) -> None:
    """Replace the facts with this head and relation by one fact: what was moved is in one place."""
    with changing(embedding, out, dry_run, json=json) as live:
        summary(live, live.move(head, relation, tail, instead_of=instead_of, source=source), json)


def remove(
    entity: tuple[str, ...] = (),
    *,
    fact: Fact = (),
    source: Source = None,
    out: Out = None,
    dry_run: DryRun = False,
    embedding: Embedding = DEFAULT,
    json: Json = False,
) -> None:
    """Take back inserted entities with all their facts, or single facts,
    those of training included.
    """
    with changing(embedding, out, dry_run, json=json) as live:
        summary(live, live.remove(list(entity), list(fact), source=source), json)


def undo(
    *, out: Out = None, dry_run: DryRun = False, embedding: Embedding = DEFAULT, json: Json = False
) -> None:
    """Take the last change back; the next time, the one before."""
    with changing(embedding, out, dry_run, json=json) as live:
        summary(live, live.undo(), json)


def compact(*, embedding: Embedding = DEFAULT) -> None:
    """Leave out of the journal what later changes have taken back; the state stays."""
    if embedding.resolve().is_relative_to(paths.FINAL_MODELS.resolve()):
        raise InputError(
            embedding, "", "expected a folder of your own: the pipeline writes this one"
        )
    with open_folder(embedding, journal=True) as live:
        gone = live.compact()
        print(f"changes left out of the journal: {gone:,}; {len(live.changes):,} are left")


def history(*, embedding: Embedding = DEFAULT, json: Json = False) -> None:
    """List all changes since training, those that were undone included."""
    from isi.live.journal import history

    changes = history(_existing(embedding))
    listed = [
        {
            "change": each.do,
            "entities": list(each.entities),
            "facts": each.facts,
            "replaced": each.replaced,
            "time": each.time and f"{each.time:%Y-%m-%d %H:%M:%S %Z}",
            "source": each.source,
        }
        for each in changes
    ]
    show({"changes": listed}, json)


def interference(
    entity: Annotated[tuple[str, ...], Parameter(help="inserted entities; default: all")] = (),
    *,
    embedding: Embedding = DEFAULT,
    top: Top = 5,
    json: Json = False,
) -> None:
    """Measure how far inserted entities push known answers down."""
    live = open_folder(embedding)
    measured = live.interference(entity, show=top)
    if measured is None:
        raise InputError(embedding, "", "expected inserted entities and known triples")
    show(asdict(measured), json)


def ask(
    head: Annotated[str | None, Parameter(help="head of the query")] = None,
    relation: Annotated[str | None, Parameter(help="relation of the query")] = None,
    tail: Annotated[str | None, Parameter(help="tail of the query")] = None,
    *,
    from_: Annotated[
        Path | None,
        Parameter(
            name="--from", help="table of queries: head, relation, tail; ? is what is asked for"
        ),
    ] = None,
    embedding: Embedding = DEFAULT,
    top: Top = 10,
    json: Json = False,
) -> None:
    """Rank the answers of a query with one part missing:
    tail, head (--tail) or relation (HEAD --tail TAIL).
    """
    if (from_ is None) == (head is None and relation is None and tail is None):
        raise InputError("", "", "expected either two of HEAD, RELATION and --tail, or --from FILE")
    live = open_folder(embedding)
    ranked: list[Answers] = []
    if from_ is None:
        with flags(ask="", entity="ENTITY", relation="RELATION"):
            ranked.append(live.ask(head, relation, tail, top))
    else:
        for line, query in _queries(from_):
            with at(from_, f"line {line}"):
                ranked.append(live.ask(*query, top=top))
    if json:
        rows = [asdict(answers) | {"sure": answers.sure} for answers in ranked]
        show(rows[0] if from_ is None else {"results": rows}, True)
        return
    for answers in ranked:
        print(
            " ".join(answers.query) + ("" if answers.sure else ": I do not know; the best guesses")
        )
        print(*(f"  {line}" for line in map(_with_mark, answers.answers)), sep="\n")


def _queries(file: Path) -> Iterator[tuple[int, tuple[str | None, str | None, str | None]]]:
    """The line and the query of each row of a table;
    None is what is asked for, ``?`` or an empty field.
    """
    from isi.sources.readers import read_table
    from isi.sources.triples import TRIPLE

    rows = read_table(file, TRIPLE, optional=TRIPLE)
    for line, *row in rows.itertuples():
        head, relation, tail = (None if part in ("", "?") else part for part in row)
        yield line, (head, relation, tail)


def nearest(
    entity: Annotated[str, Parameter(help="entity whose nearest neighbours are listed")],
    *,
    embedding: Embedding = DEFAULT,
    top: Top = 10,
    json: Json = False,
) -> None:
    """List the other entities by the cosine of their vectors with the entity's."""
    live = open_folder(embedding)
    with flags(entity="ENTITY"):
        neighbours = live.nearest(entity, top)
    kinds = dict(zip(live.now.entity_names, live.now.kinds, strict=True))
    rows = [
        {"entity": name, "kind": kinds[name] or None, "cosine": cosine}
        for name, cosine in neighbours
    ]
    show({"entity": entity, "nearest": rows}, json)


def explain(
    entity: Annotated[str, Parameter(help="an inserted entity")],
    *,
    embedding: Embedding = DEFAULT,
    top: Top = 5,
    verbose: Verbose = False,
    json: Json = False,
) -> None:
    """Explain an insertion: its indicators, and the effect of each fact,
    of the words and of each indicator.
    """
    live = open_folder(embedding)
    with flags(entity="ENTITY"):
        explanation = live.explain(entity, top)
    show(asdict(explanation), True) if json else print(
        *why_in_words(explanation, verbose), sep="\n"
    )


def in_words(report: Report, verbose: bool) -> Iterator[str]:
    """The report of an insertion as sentences, the most important first."""
    most = None if verbose else FEW
    kind = f" as {report.kind}" if report.kind else ""
    yield (
        f"{report.entity} is inserted{kind}; most like "
        f"{_joined([each.entity for each in report.indicators[:3]])}"
    )
    for answers in [
        each for each in report.answers if verbose or each.sure or each.query[0] == report.entity
    ][:most]:
        best = ", ".join(map(_with_mark, answers.answers if answers.sure else answers.answers[:1]))
        yield (
            f"  {' '.join(answers.query)}: "
            f"{best if answers.sure else f'I do not know; the best guess is {best}'}"
        )
    if report.unsupported:
        listed = (
            f"{' '.join(triple)} ({_percent(likely)})"
            for triple, likely in report.unsupported[:most]
        )
        yield f"predicted without support of a similar entity: {'; '.join(listed)}"
    yield from mrr_in_words(report.interference_of_all)
    yield from _falls_in_words(report, verbose)
    yield from report.notes[:most]
    if verbose:
        options = ", ".join(f"{key} {value}" for key, value in report.options.items())
        yield f"by {report.initializer} ({options}): {report.why}; word vector: {report.words}"


def why_in_words(explanation: Explanation, verbose: bool) -> Iterator[str]:
    """An explanation as sentences."""
    most = None if verbose else FEW
    kind = explanation.kind or "of no known kind"
    yield f"{explanation.entity}: {kind}, inserted by {explanation.initializer} ({explanation.why})"
    yield "facts: " + ("; ".join(map(" ".join, explanation.facts)) or "none")
    yield "most like " + _joined([each.entity for each in explanation.indicators[:most]])
    for piece in [
        each for each in explanation.without if verbose or each.changes or each.moved is None
    ][:most]:
        if piece.moved is None:
            yield f"without the {piece.left_out} {piece.what}: nothing is left to insert it from"
            continue
        yield (
            f"without the {piece.left_out} {piece.what}: the vector moves by "
            f"{piece.moved:.0%} of its length"
        )
        for query, lost, added in piece.changes[: most and 2]:
            yield f"  {' '.join(query)}: {_joined(added)} instead of {_joined(lost)}"
    yield from explanation.notes[:most]


def summary(live: LiveEmbedding, effect: Effect, json: bool) -> None:
    """Print what a change did, and the interference of all insertions."""
    measured = live.interference()
    if json:
        show(asdict(effect) | {"interference_of_all": measured and asdict(measured)}, True)
        return
    lines = list[str]()
    for change in ("inserted", "updated", "removed"):
        if names := getattr(effect, change):
            more = f" and {len(names) - LISTED:,} more" if len(names) > LISTED else ""
            lines.append(f"{change}: {', '.join(names[:LISTED])}{more}")
    if effect.facts:
        lines.append(f"facts added: {effect.facts:,}")
    if effect.lost:
        lines.append(f"facts removed: {len(effect.lost):,}")
    lines = lines or ["nothing has changed"]
    if effect.known:
        lines.append(f"facts that were known already: {effect.known:,}")
    print(*lines, *mrr_in_words(measured), *effect.notes, sep="\n")


def mrr_in_words(of_all: Interference | None) -> Iterator[str]:
    if of_all:
        yield (
            f"MRR of known triples: {of_all.h_old:.3f} before all insertions, "
            f"{of_all.h_cur:.3f} now"
        )


def _falls_in_words(report: Report, verbose: bool) -> Iterator[str]:
    """How often the new entity alone ranks above a known answer, if ever;
    if ``verbose``, the answers that fall most.
    """
    alone = report.interference
    if not alone or not alone.above[0]:
        return
    yield (
        f"{report.entity} ranks above the known answer in {alone.above[0]:.1%} "
        f"of {alone.queries:,} queries of known triples"
    )
    for change in alone.changes if verbose else ():
        yield (
            f"  {' '.join(map(str, change.query))}: {change.answer} falls "
            f"from rank {change.rank_old:g} to {change.rank_cur:g}"
        )


def _options_in_params(initializer: str | None) -> dict[str, Any]:
    """The options of an initializer under ``initializers`` in ``params.yaml``;
    empty outside a project's folder.
    """
    values = read(paths.PARAMS) if initializer and paths.PARAMS.exists() else {}
    return check(
        value_of(values, f"initializers.{initializer}") or {},
        dict[str, Any],
        f"initializers.{initializer}",
    )


def _with_mark(best: Answer) -> str:
    mark = "given" if best.given else "known" if best.known else _percent(best.probability)
    return f"{best.entity} ({mark}{', inserted' * best.inserted})"


def _percent(probability: float | None) -> str:
    return "no probability" if probability is None else f"{probability:.0%}"


def _joined(names: Sequence[str]) -> str:
    return ", ".join(names) or "nothing"


def _about(name: str, fact: tuple[str, str, str]) -> tuple[str, str, str]:
    """A fact that has a name at an end; InputError for another one."""
    if name not in (fact[0], fact[2]):
        expected = (
            "expected RELATION ENTITY, or three parts, of which NAME is the first or the last"
        )
        place = " ".join(fact)[:80]
        raise InputError("--fact", place, f"{expected}; a name of several words stands in quotes")
    return fact


def _from_files(
    live: LiveEmbedding, files: Sequence[Path]
) -> tuple[list[str], list[list[str]], dict[str, str]]:
    """Names that are new in files, all facts, and the kinds of new names that the bundle has."""
    from isi.graph.files import read_graph

    tables, _ = read_graph(files)
    kinds = dict(zip(tables.entities["entity"], tables.entities["kind"], strict=True))
    facts = tables.triples[["head", "relation", "tail"]].to_numpy().tolist()
    known = live.now.known_entities
    names = [name for name in kinds if known.same(name) is None]
    return names, facts, {name: kinds[name] for name in names if kinds[name] in live.base.kinds}


@contextmanager
def changing(
    path: Path, out: Path | None, dry_run: bool, vectors: Path | None = None, json: bool = False
) -> Iterator[LiveEmbedding]:
    """Open a bundle for a change; then write it to ``out``,
    or to its own folder unless the pipeline wrote this.
    """
    pipeline = paths.FINAL_MODELS.resolve()
    if out and out.resolve().is_relative_to(pipeline):
        raise InputError(
            "--out",
            "",
            f"expected a folder outside of {paths.FINAL_MODELS}, which the pipeline writes",
        )
    in_place = not (
        dry_run
        or path.resolve().is_relative_to(pipeline)
        or (out and out.resolve() != path.resolve())
    )
    if vectors and in_place:
        raise InputError(
            "--vectors", "", "expected --out FOLDER: the vectors of all entities' names change"
        )
    printed = StringIO()  # a command that cannot write prints no result
    with open_folder(path, vectors, journal=in_place) as live, redirect_stdout(printed):
        before = len(live.changes)
        yield live
        if out and not in_place and not dry_run:
            live.save(out)
    print(printed.getvalue(), end="")
    if not json and (len(live.changes) > before or not in_place):
        written = path if in_place else out
        hint = "" if dry_run else ": --out FOLDER writes it"
        print(f"written: {written}" if written and not dry_run else f"nothing is written{hint}")


def _existing(path: Path) -> Path:
    """The folder; an ``InputError`` says how to get the default one where it is missing."""
    if path == DEFAULT and not path.exists():
        here = "not trained yet: run `dvc repro train_final`"
        away = f"no such folder in {Path.cwd()}: run this in the folder of the project"
        raise InputError(
            path,
            "",
            f"{here if paths.PARAMS.exists() else away}, or name a bundle by --embedding DIR",
        )
    return path


def open_folder(path: Path, vectors: Path | None = None, journal: bool = False) -> LiveEmbedding:
    """Open the bundle of a folder. An ``InputError`` refuses a missing or broken one."""
    _existing(path)
    # what is imported stays: without the collector, the imports and the end take 0.2 s less
    gc.disable()
    import torch

    from isi.live.embedding import open_live

    gc.freeze()
    gc.enable()
    torch.set_num_threads(1)  # so that equal commands write equal bytes
    live = open_live(path, vectors=vectors, journal=journal)
    live.note = partial(print, file=sys.stderr)
    return live
