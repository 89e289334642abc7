"""Commands about a home, one for each verb (``isi.home.verbs``): tell, move, remove, undo, ask, ...

A command imports its modules when it runs, so that ``--help`` does not wait for PyTorch. An
``InputError`` refuses a broken home or an unknown name.
"""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from isi.cli import HOME, HomeFolder, Json, flags, show
from isi.cli.options import command_of
from isi.errors import InputError, at
from isi.home import verbs

if TYPE_CHECKING:
    from isi.home.answers import Answer, Answers
    from isi.home.changes import Effect
    from isi.home.explain import Explanation
    from isi.home.home import Home

#: Queries, notes and indicators in a text, unless ``--verbose``; answers to each query.
FEW = 5
LISTED = 20  #: Names of entities in a text.
Verbose = Annotated[bool, Parameter(help="print all queries, notes and indicators")]


# -- changes ---------------------------------------------------------------------------------------


@Parameter(name="*")
@dataclass(frozen=True)
class ChangeOptions:
    """Options of each command that changes a home."""

    dry_run: Annotated[bool, Parameter(help="print the effect and change nothing")] = False
    mrr: Annotated[bool, Parameter(help="print what insertions cost known triples")] = False
    folder: HomeFolder = HOME
    json: Json = False

    def show(
        self, home: Home, effect: Effect, is_told: bool = False, verbose: bool = False
    ) -> None:
        """Print what a change did; of one new entity that is told, what is predicted about it,
        too.
        """
        about, answers = None, []
        if len(effect.inserted) == 1 and is_told:
            (name,) = effect.inserted
            about, answers = home.explain(name), predicted(home, name)
        measured = home.interference() if self.mrr else None
        if self.json:
            fields = asdict(effect)
            if about is not None:
                fields |= {"explanation": asdict(about), "answers": list(map(asdict, answers))}
            if measured is not None:
                fields |= {"mrr_before": measured.h_old, "mrr": measured.h_cur}
            show(fields, True)
            return
        sentences = list(changes_in_words(effect))
        if about is not None:
            sentences = [*in_words(about, answers, verbose), *sentences[1:]]
        sentences += [note for note in effect.notes if about is None or note not in about.notes]
        if measured is not None:
            sentences.append(
                f"MRR of known triples: {measured.h_old:.3f} before all insertions, "
                f"{measured.h_cur:.3f} now"
            )
        print(*(sentences or ["nothing has changed"]), sep="\n")
        if self.dry_run:
            print("nothing is written")


def _change(verb: verbs.Verb, change_options: ChangeOptions) -> None:
    with home_in(change_options.folder, change_options.dry_run) as home, named_options():
        change_options.show(home, verb.of(home))


@command_of
def tell(
    verb: verbs.Tell,
    *,
    from_: Annotated[
        tuple[Path, ...], Parameter(name="--from", help="triples, scenes, ...: all their facts")
    ] = (),
    verbose: Verbose = False,
    change_options: ChangeOptions = ChangeOptions(),
) -> None:
    """Tell facts; what is not known yet is inserted."""
    if not (verb.facts or verb.entities or from_):
        raise InputError("", "", "expected HEAD RELATION TAIL, --entity NAME or --from FILE")
    with home_in(change_options.folder, change_options.dry_run) as home, named_options():
        if from_:
            rows, kinds = _from_files(home, from_)
            told = {"facts": [*verb.facts, *rows], "kind": verb.kind or kinds}
            verb = verb.model_copy(update=told)
        change_options.show(home, verb.of(home), is_told=True, verbose=verbose)


@command_of
def move(verb: verbs.Move, *, change_options: ChangeOptions = ChangeOptions()) -> None:
    """Replace the facts with a head and a relation by one."""
    _change(verb, change_options)


@command_of
def remove(verb: verbs.Remove, *, change_options: ChangeOptions = ChangeOptions()) -> None:
    """Take back inserted entities, or single facts."""
    _change(verb, change_options)


@command_of
def undo(verb: verbs.Undo, *, change_options: ChangeOptions = ChangeOptions()) -> None:
    """Take a change back."""
    _change(verb, change_options)


# -- questions -------------------------------------------------------------------------------------


@command_of
def ask(
    verb: verbs.Ask,
    *,
    from_: Annotated[
        Path | None,
        Parameter(
            name="--from", help="table of queries: head, relation, tail; ? is what is asked for"
        ),
    ] = None,
    folder: HomeFolder = HOME,
    json: Json = False,
) -> None:
    """Rank the answers of a query with one part missing."""
    if (from_ is None) == ((verb.head, verb.relation, verb.tail) == (None, None, None)):
        raise InputError("", "", "expected either two of HEAD, RELATION and --tail, or --from FILE")
    with home_in(folder) as home:
        if from_ is None:
            with flags(ask="", entity="ENTITY", relation="RELATION"):
                ranked = [verb.of(home)]
        else:
            ranked = []
            for line, query in _queries(from_):
                with at(from_, f"line {line}"):
                    ranked.append(verb.model_copy(update=query).of(home))
    if json:
        rows = [asdict(answers) | {"sure": answers.sure} for answers in ranked]
        show(rows[0] if from_ is None else {"results": rows}, True)
        return
    for answers in ranked:
        print(*answers.notes, sep="\n", end="\n" * bool(answers.notes))
        unsure = "" if answers.sure else ": I do not know; the best guesses"
        print(" ".join(answers.query) + unsure)
        print(*(f"  {line}" for line in map(_with_mark, answers.answers)), sep="\n")


def _queries(file: Path) -> Iterator[tuple[int, dict[str, str | None]]]:
    """The line and the query of each row of a table;
    None is what is asked for, ``?`` or an empty field.
    """
    from isi.sources.readers import read_table
    from isi.sources.triples import TRIPLE

    rows = read_table(file, TRIPLE, optional=TRIPLE)
    for line, *row in rows.itertuples():
        parts = (None if part in ("", "?") else part for part in row)
        yield line, dict(zip(TRIPLE, parts, strict=True))


@command_of
def nearest(verb: verbs.Nearest, *, folder: HomeFolder = HOME, json: Json = False) -> None:
    """List the entities with the most similar vectors."""
    with home_in(folder) as home, named_options():
        rows = [{"entity": entity, "cosine": cosine} for entity, cosine in verb.of(home)]
    show({"nearest": rows}, json)


@command_of
def explain(
    verb: verbs.Explain, *, folder: HomeFolder = HOME, verbose: Verbose = False, json: Json = False
) -> None:
    """Explain an insertion: its facts, its words and its indicators."""
    with home_in(folder) as home, named_options():
        explanation = verb.of(home)
    if json:
        show(asdict(explanation), True)
    else:
        print(*why_in_words(explanation, verbose), sep="\n")


@command_of
def facts(verb: verbs.KnownFacts, *, folder: HomeFolder = HOME, json: Json = False) -> None:
    """List what is known of a thing, or all facts."""
    with home_in(folder) as home, named_options():
        show({"facts": list(map(_row_of_fact, verb.of(home)))}, json)


@command_of
def stale(verb: verbs.Stale, *, folder: HomeFolder = HOME, json: Json = False) -> None:
    """List facts that were not seen for long."""
    with home_in(folder) as home:
        show({"stale": list(map(_row_of_fact, verb.of(home)))}, json)


def _row_of_fact(row: Any) -> dict[str, Any]:
    fields = "status", "count", "confidence", "first_seen", "last_seen", "source"
    return {"fact": row.fact} | {name: getattr(row, name) for name in fields}


@command_of
def history(verb: verbs.History, *, folder: HomeFolder = HOME, json: Json = False) -> None:
    """List changes, those that were undone included."""
    lists = "inserted", "removed", "relations", "added", "seen", "lost"
    with home_in(folder) as home:
        rows = [
            {"id": each.id, "change": f"{each.verb}{' (undone)' * each.undone}"}
            | {name: getattr(each, name) for name in lists}
            | {"time": f"{each.time:%Y-%m-%d %H:%M:%S} UTC", "source": each.source}
            for each in verb.of(home)
        ]
    show({"changes": rows}, json)


@command_of
def forget(verb: verbs.Forget, *, folder: HomeFolder = HOME) -> None:
    """Drop old changes from the history; what holds stays."""
    with home_in(folder) as home:
        print(f"forgotten changes: {verb.of(home):,}")


@command_of
def save(verb: verbs.Save, *, of: HomeFolder = HOME) -> None:
    """Write a copy of a home into another folder."""
    with home_in(of) as home:
        verb.of(home)
    print(f"The copy is in {verb.folder}")


# -- in words --------------------------------------------------------------------------------------


def predicted(home: Home, name: str) -> list[Answers]:
    """The answers to all queries about an entity that fit it."""
    ranked = []
    for relation in home.base.relation_names:
        for head, tail in ((name, None), (None, name)):
            answers = home.ask(head, relation, tail, top=FEW)
            if any(best.known or best.probability != 0 for best in answers.answers):
                ranked.append(answers)
    return ranked


def in_words(about: Explanation, ranked: Sequence[Answers], verbose: bool) -> Iterator[str]:
    """An insertion as sentences, the most important first."""
    most = None if verbose else FEW
    kind = f" as {about.kind}" if about.kind else ""
    alike = _joined([each.entity for each in about.indicators[:3]])
    yield f"{about.entity} is inserted{kind}; most like {alike}"
    shown = [each for each in ranked if verbose or each.sure or each.query[0] == about.entity]
    for answers in shown[:most]:
        best = ", ".join(map(_with_mark, answers.answers if answers.sure else answers.answers[:1]))
        guess = best if answers.sure else f"I do not know; the best guess is {best}"
        yield f"  {' '.join(answers.query)}: {guess}"
    yield from about.notes[:most]
    if verbose:
        options = ", ".join(f"{key} {value}" for key, value in about.options.items())
        yield f"by {about.initializer} ({options}): {about.why}; word vector: {about.words}"


def why_in_words(explanation: Explanation, verbose: bool) -> Iterator[str]:
    """An explanation as sentences."""
    most = None if verbose else FEW
    kind = explanation.kind or "of no known kind"
    yield f"{explanation.entity}: {kind}, inserted by {explanation.initializer} ({explanation.why})"
    yield "facts: " + ("; ".join(map(" ".join, explanation.facts)) or "none")
    yield f"word vector: {explanation.words}"
    yield "most like " + _joined([each.entity for each in explanation.indicators[:most]])
    yield from explanation.notes[:most]


def changes_in_words(effect: Effect) -> Iterator[str]:
    """What a change did, a line for each kind of change."""
    for label in ("inserted", "updated", "removed", "relations"):
        names = getattr(effect, label)
        more = f" and {len(names) - LISTED:,} more" * (len(names) > LISTED)
        if names:
            yield f"{label}: {', '.join(names[:LISTED])}{more}"
    for label, number in (
        ("facts added", effect.facts),
        ("facts removed", len(effect.lost)),
        ("facts seen again", effect.seen),
    ):
        if number:
            yield f"{label}: {number:,}"


def _with_mark(best: Answer) -> str:
    mark = "given" if best.given else "known" if best.known else _percent(best.probability)
    return f"{best.entity} ({mark}{', inserted' * best.inserted})"


def _percent(probability: float | None) -> str:
    return "no probability" if probability is None else f"{probability:.0%}"


def _joined(names: Sequence[str]) -> str:
    return ", ".join(names) or "nothing"


# -- homes and files -------------------------------------------------------------------------------


def named_options() -> AbstractContextManager[None]:
    """In an ``InputError``, arguments of a home get the names of options."""
    return flags(initializer="--initializer", options="--set", entity="ENTITY")


def _from_files(home: Home, files: Sequence[Path]) -> tuple[list[list[str]], Mapping[str, str]]:
    """The facts of files, and the kinds of new names that the home has."""
    from isi.graph.files import read_graph

    tables, _ = read_graph(files)
    rows = tables.triples[["head", "relation", "tail"]].to_numpy().tolist()
    known, kinds = home.now.names, {*home.base.kinds}
    entities = tables.entities[["entity", "kind"]].astype(str).itertuples(index=False)
    new = {name: kind for name, kind in entities if kind in kinds and known.same(name) is None}
    return rows, new


def home_in(path: Path, dry_run: bool = False) -> Home:
    """Open the home of a folder. An ``InputError`` refuses a missing or broken one."""
    if path == HOME and not path.exists():
        expected = f"no such folder in {Path.cwd()}: name a home by --home DIR or ISI_HOME"
        raise InputError(path, "", f"{expected}; isi train makes one")
    # of PyTorch, where it is needed: so that equal commands write equal bytes
    os.environ |= {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    # what is imported stays: without the collector, the imports and the end take 0.2 s less
    gc.disable()
    from isi.home.home import open_home

    gc.freeze()
    gc.enable()
    return open_home(path, "memory" if dry_run else "full")
