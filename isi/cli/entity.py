"""Commands about a home, one for each verb of ``Home``: tell, move, remove, undo, ask, ...

A command imports its modules when it runs, so that ``--help`` does not wait for PyTorch. An
``InputError`` refuses a broken home or an unknown name.
"""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import asdict, dataclass
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from isi.cli import FROM_ZERO, HOME, HomeFolder, Json, Settings, Top, flags, settings, show
from isi.config import check, read, value_of
from isi.errors import InputError, at
from isi.tables import paths

if TYPE_CHECKING:
    from isi.home.answers import Answer
    from isi.home.changes import Effect
    from isi.home.explain import Explanation, Report
    from isi.home.home import Home

FEW = 5  #: Queries, notes and indicators in a text, unless ``--verbose``.
LISTED = 20  #: Names of entities in a text.
FactsOption = Annotated[
    tuple[tuple[str, str, str], ...],
    Parameter(name="--fact", help="HEAD RELATION TAIL: a fact; may repeat"),
]
ConfidenceOption = Annotated[
    float | None, Parameter(help="how far the facts are believed, up to 1")
]
Verbose = Annotated[bool, Parameter(help="print all queries, notes and indicators")]


@Parameter(name="*")
@dataclass(frozen=True)
class ChangeOptions:
    """Options of each command that changes a home."""

    time: Annotated[
        str | None, Parameter(help="when it was seen, as 2026-11-25T09:30; default: now")
    ] = None
    source: Annotated[str | None, Parameter(help="what reported it, for the history")] = None
    dry_run: Annotated[bool, Parameter(help="print the effect and change nothing")] = False
    folder: HomeFolder = HOME
    json: Json = False

    @property
    def stamp(self) -> dict[str, Any]:
        """When it was made, and what reported it."""
        return {"time": self.time, "source": self.source}

    @contextmanager
    def opened(self) -> Iterator[Home]:
        """The home, or a copy of it in memory."""
        printed = StringIO()  # a command that cannot write prints no result
        with home_in(self.folder, self.dry_run) as home, redirect_stdout(printed):
            yield home
        print(printed.getvalue(), end="")
        if self.dry_run and not self.json:
            print("nothing is written")


@Parameter(name="*")
@dataclass(frozen=True)
class EntityOptions:
    """Options about new entities, and how they are reported."""

    definition: Annotated[str | None, Parameter(help="a sentence, for the word vector")] = None
    kind: Annotated[
        str | None, Parameter(help="default: what the facts, else the words suggest")
    ] = None
    confidence: ConfidenceOption = None
    new: Annotated[bool, Parameter(help="insert a name that looks like a known one")] = False
    initializer: Annotated[
        str | None, Parameter(help="default: the best for hidden known entities")
    ] = None
    set: Annotated[Settings, Parameter(help="KEY=VALUE: an option of --initializer")] = ()
    seed: Annotated[int, Parameter(validator=FROM_ZERO, help="seed of a random initializer")] = 0
    top: Top = 5
    verbose: Verbose = False

    def arguments(self) -> dict[str, Any]:
        """The arguments of ``Home.tell`` but the facts."""
        arguments = asdict(self)
        for of_report in ("set", "top", "verbose"):
            del arguments[of_report]
        return arguments | {"options": _options(self.initializer, self.set)}


def tell(
    head: Annotated[str | None, Parameter(help="head of a fact")] = None,
    relation: Annotated[str | None, Parameter(help="relation of the fact")] = None,
    tail: Annotated[str | None, Parameter(help="tail of the fact")] = None,
    *,
    fact: FactsOption = (),
    from_: Annotated[
        tuple[Path, ...], Parameter(name="--from", help="triples, scenes, ...: all their facts")
    ] = (),
    entity: Annotated[
        tuple[str, ...], Parameter(help="a new entity by its words alone; may repeat")
    ] = (),
    about: EntityOptions = EntityOptions(),
    change: ChangeOptions = ChangeOptions(),
) -> None:
    """Tell facts: what is not known is inserted, what is known is seen once more.
    A relation is new if two or more facts have it.
    """
    typed = (head, relation, tail)
    if relation is not None and tail is None:
        raise InputError("", "", "expected HEAD RELATION TAIL, or --fact HEAD RELATION TAIL")
    if head is not None and relation is None:
        raise InputError("", "", f"expected HEAD RELATION TAIL, or --entity {head!r} for its words")
    facts: list[Any] = [*([typed] if tail is not None else []), *fact]
    if not (facts or from_ or entity):
        raise InputError("", "", "expected HEAD RELATION TAIL, --fact, --entity or --from FILE")
    arguments = about.arguments()
    with change.opened() as home, flags(initializer="--initializer", options="--set"):
        if from_:
            of_files, kinds = _from_files(home, from_)
            facts += of_files
            arguments |= {"kind": about.kind or kinds, "new": True}  # names in files are exact
        effect = home.tell(facts, entities=entity, **arguments, **change.stamp)
        show_effect(home, effect, change.json, about)


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
    upsert: Annotated[
        bool, Parameter(help="if NAME is known already, add the facts alone")
    ] = False,
    about: EntityOptions = EntityOptions(),
    change: ChangeOptions = ChangeOptions(),
) -> None:
    """Insert an entity by its facts and words, and report what is predicted about it."""
    if name is None and len(whole_fact) == 1:  # --fact RELATION ENTITY NAME
        fact, name, whole_fact = (*fact, whole_fact[0][:2]), whole_fact[0][2], ()
    if name is None:
        raise InputError("", "", "expected NAME, with --fact RELATION ENTITY")
    facts = [(name, *pair) for pair in fact] + [(*pair, name) for pair in inverse_fact]
    facts += [_about(name, whole) for whole in whole_fact]
    arguments = about.arguments()
    with change.opened() as home, flags(initializer="--initializer", options="--set"):
        effect = home.insert(name, facts, upsert=upsert, **arguments, **change.stamp)
        show_effect(home, effect, change.json, about)


def observe(
    fact: FactsOption = (),
    *,
    new: Annotated[bool, Parameter(help="insert entities that are not known yet")] = False,
    confidence: ConfidenceOption = None,
    change: ChangeOptions = ChangeOptions(),
) -> None:
    """Tell facts of entities that are known."""
    with change.opened() as home:
        effect = home.observe(list(fact), upsert=new, confidence=confidence, **change.stamp)
        show_effect(home, effect, change.json)


def move(
    head: Annotated[str, Parameter(help="head of the fact")],
    relation: Annotated[str, Parameter(help="relation of the fact")],
    tail: Annotated[str, Parameter(help="its new tail")],
    *,
    instead_of: Annotated[
        str | None, Parameter(help="replace the fact with this tail alone; default: all")
    ] = None,
    change: ChangeOptions = ChangeOptions(),
) -> None:
    """Replace the facts with this head and relation by one fact: what was moved is in one place."""
    with change.opened() as home:
        effect = home.move(head, relation, tail, instead_of=instead_of, **change.stamp)
        show_effect(home, effect, change.json)


def remove(
    entity: tuple[str, ...] = (), *, fact: FactsOption = (), change: ChangeOptions = ChangeOptions()
) -> None:
    """Take back inserted entities with all their facts, or single facts,
    those of training included.
    """
    with change.opened() as home:
        effect = home.remove(list(entity), list(fact), **change.stamp)
        show_effect(home, effect, change.json)


def undo(*, change: ChangeOptions = ChangeOptions()) -> None:
    """Take the last change back; the next time, the one before."""
    with change.opened() as home:
        show_effect(home, home.undo(**change.stamp), change.json)


def history(
    *,
    stale: Annotated[
        str | None, Parameter(help="list facts that were not seen for so long: 30d, 12h")
    ] = None,
    folder: HomeFolder = HOME,
    json: Json = False,
) -> None:
    """List all changes, those that were undone included; or facts that may have changed."""
    from isi.home.stream import AGE

    if stale is not None:
        with at("--stale"):
            age = AGE.validate_python(stale)
        with home_in(folder) as home:
            facts = home.stale(age)
        rows = [
            {"fact": row.fact, "count": row.count, "last_seen": row.last_seen, "source": row.source}
            for row in facts
        ]
        show({"stale": rows}, json)
        return
    with home_in(folder) as home:
        changes = home.history
    rows_of_changes: list[dict[str, Any]] = [
        {
            "change": f"{each.verb}{' (undone)' * each.undone}",
            "inserted": each.inserted,
            "removed": each.removed,
            "added": each.added,
            "seen": each.seen,
            "lost": each.lost,
            "time": f"{each.time:%Y-%m-%d %H:%M:%S} UTC",
            "source": each.source,
        }
        for each in changes
    ]
    show({"changes": rows_of_changes}, json)


def ask(
    head: Annotated[str | None, Parameter(help="head of the query")] = None,
    relation: Annotated[str | None, Parameter(help="relation of the query")] = None,
    tail: Annotated[str | None, Parameter(help="tail of the query")] = None,
    *,
    new: Annotated[bool, Parameter(help="leave out what is known")] = False,
    among: Annotated[
        tuple[str, ...],
        Parameter(consume_multiple=True, show_default=False, help="rank these entities alone"),
    ] = (),
    from_: Annotated[
        Path | None,
        Parameter(
            name="--from", help="table of queries: head, relation, tail; ? is what is asked for"
        ),
    ] = None,
    folder: HomeFolder = HOME,
    top: Top = 10,
    json: Json = False,
) -> None:
    """Rank the answers of a query with one part missing:
    tail, head (--tail) or relation (HEAD --tail TAIL).
    """
    if (from_ is None) == (head is None and relation is None and tail is None):
        raise InputError("", "", "expected either two of HEAD, RELATION and --tail, or --from FILE")
    candidates = list(among) or None
    with home_in(folder) as home:
        if from_ is None:
            with flags(ask="", entity="ENTITY", relation="RELATION"):
                ranked = [home.ask(head, relation, tail, top, new=new, among=candidates)]
        else:
            ranked = []
            for line, query in _queries(from_):
                with at(from_, f"line {line}"):
                    ranked.append(home.ask(*query, top=top, new=new, among=candidates))
    if json:
        rows = [asdict(answers) | {"sure": answers.sure} for answers in ranked]
        show(rows[0] if from_ is None else {"results": rows}, True)
        return
    for answers in ranked:
        print(*answers.notes, sep="\n", end="\n" * bool(answers.notes))
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


def explain(
    entity: Annotated[str, Parameter(help="an inserted entity")],
    *,
    folder: HomeFolder = HOME,
    verbose: Verbose = False,
    json: Json = False,
) -> None:
    """Explain an insertion: its facts, its words and its indicators."""
    with home_in(folder) as home, flags(entity="ENTITY"):
        explanation = home.explain(entity)
    show(asdict(explanation), True) if json else print(
        *why_in_words(explanation, verbose), sep="\n"
    )


def show_effect(
    home: Home, effect: Effect, as_json: bool, about: EntityOptions | None = None
) -> None:
    """Print what a change did; of one new entity, if there are options ``about`` it, what is
    predicted about it.
    """
    report, is_verbose = None, False
    if about is not None and len(effect.inserted) == 1:
        report, is_verbose = home.report(effect.inserted[0], about.top), about.verbose
    if as_json:
        of_report = {} if report is None else {"report": asdict(report)}
        show(asdict(effect) | of_report, True)
        return
    done = list(changes_in_words(effect) if report is None else in_words(report, is_verbose))
    if effect.inserted or effect.updated:
        done += costs_in_words(home)
    notes = [note for note in effect.notes if report is None or note not in report.notes]
    print(*(done + notes or ["nothing has changed"]), sep="\n")


def in_words(report: Report, verbose: bool) -> Iterator[str]:
    """The report of an insertion as sentences, the most important first."""
    most = None if verbose else FEW
    kind = f" as {report.kind}" if report.kind else ""
    alike = _joined([each.entity for each in report.indicators[:3]])
    yield f"{report.entity} is inserted{kind}; most like {alike}"
    shown = [
        each for each in report.answers if verbose or each.sure or each.query[0] == report.entity
    ]
    for answers in shown[:most]:
        best = ", ".join(map(_with_mark, answers.answers if answers.sure else answers.answers[:1]))
        guess = best if answers.sure else f"I do not know; the best guess is {best}"
        yield f"  {' '.join(answers.query)}: {guess}"
    if report.unsupported:
        unsupported = (
            f"{' '.join(triple)} ({_percent(likely)})"
            for triple, likely in report.unsupported[:most]
        )
        yield f"predicted without support of a similar entity: {'; '.join(unsupported)}"
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
    yield f"word vector: {explanation.words}"
    yield "most like " + _joined([each.entity for each in explanation.indicators[:most]])
    yield from explanation.notes[:most]


def changes_in_words(effect: Effect) -> Iterator[str]:
    """What a change did, a line for each kind of change."""
    for label, names in (
        ("inserted", effect.inserted),
        ("updated", effect.updated),
        ("removed", effect.removed),
        ("new relations", effect.relations),
    ):
        more = f" and {len(names) - LISTED:,} more" * (len(names) > LISTED)
        if names:
            yield f"{label}: {', '.join(names[:LISTED])}{more}"
    for label, number in (
        ("facts added", effect.facts),
        ("facts removed", len(effect.lost)),
        ("facts seen again", effect.known),
    ):
        if number:
            yield f"{label}: {number:,}"


def costs_in_words(home: Home) -> Iterator[str]:
    """What all insertions cost earlier knowledge."""
    if measured := home.interference():
        yield (
            f"MRR of known triples: {measured.h_old:.3f} before all insertions, "
            f"{measured.h_cur:.3f} now"
        )


def _options(initializer: str | None, typed: Sequence[str]) -> dict[str, Any]:
    """The options of an initializer: those of ``--set``, then those under ``initializers`` in
    ``params.yaml``, which is there in a project's folder.
    """
    if typed and initializer is None:
        raise InputError("--set", "", "expected an --initializer: --set gives its options")
    values = read(paths.PARAMS) if initializer and paths.PARAMS.exists() else {}
    key = f"initializers.{initializer}"
    return check(value_of(values, key) or {}, dict[str, Any], key) | settings(typed)


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


def _from_files(home: Home, files: Sequence[Path]) -> tuple[list[list[str]], Mapping[str, str]]:
    """The facts of files, and the kinds of new names that the home has."""
    from isi.home.files import read_graph

    tables, _ = read_graph(files)
    facts = tables.triples[["head", "relation", "tail"]].to_numpy().tolist()
    known, kinds = home.now.names, {*home.base.kinds}
    entities = tables.entities[["entity", "kind"]].astype(str).itertuples(index=False)
    new = {name: kind for name, kind in entities if kind in kinds and known.same(name) is None}
    return facts, new


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
