"""The report as files: one self-contained HTML page, all tables and figures,
headline numbers and curves.
"""

import hashlib
import json
import re
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from itertools import groupby
from pathlib import Path
from typing import Any, Self

import matplotlib as mpl
import pandas as pd
from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from jinja2.utils import htmlsafe_json_dumps
from markdown_it import MarkdownIt
from markupsafe import Markup

from isi import config
from isi.report import charts, figures, glossary, stats, words
from isi.report.data import Experiment, Results
from isi.report.figures import STYLE, Figure, in_words, rendered
from isi.report.section import Block, FilledSection, ReportSection
from isi.report.sections import finetuning, queries
from isi.report.stats import where
from isi.report.tables import Column, Estimate, ReportTable, csv, number
from isi.report.words import BASELINE, HALVES, JOINT, TEMPLATES, WORDS, joined, label
from isi.tables.io import atomically

#: The pages with their titles and sections, and the paper's figures and tables with their places on
#: the first page.
PAGES = config.read(TEMPLATES / "pages.yaml")
#: The headline numbers, beside the page.
METRICS = "metrics.json"
#: A formatted number that is NaN or infinite, with its interval, in a sentence.
_ABSENT = re.compile(r"(?<![\w.-])[+\-−±]?(?:nan|inf)\b(?: \[[+-]?nan, [+-]?nan\])?")


@dataclass(frozen=True)
class Page:
    """A page of the report: its name in ``pages.yaml``, and its sections;
    ``picture`` and ``answer`` stand above the others.
    """

    name: str
    sections: Sequence[ReportSection]
    answer: ReportSection | None = None
    picture: ReportSection | None = None

    @classmethod
    def of(cls, name: str) -> Self:
        """A page by its name."""
        about = PAGES[name]
        sections = [
            ReportSection.of(place, group)
            for group, places in about["sections"].items()
            for place in places
        ]
        first = {
            kind: ReportSection.of(about[kind]) for kind in ("answer", "picture") if kind in about
        }
        return cls(name, sections, **first)

    def write(self, folder: Path, results: Results) -> None:
        """Write all files into ``folder``, each atomically;
        delete tables and figures of earlier reports.
        """
        with mpl.rc_context(STYLE):
            answer = self.answer.filled(results) if self.answer else None
            picture = self.picture.filled(results) if self.picture else None
            parts = [part for section in self.sections if (part := section.filled(results))]
        files, drawings = dict[str, bytes](), dict[str, Markup]()
        for block in _blocks(parts, answer):
            item = block.content
            if isinstance(item, ReportTable):
                for form, text in item.files.items():
                    files[f"tables/{item.name}.{form}"] = text.encode()
            elif isinstance(item, Figure):
                svg = rendered(item.canvas, "svg").decode()
                shown = charts.themed(svg) if item.chart else svg
                files[f"figures/{item.name}.svg"] = shown.encode()
                files[f"figures/{item.name}.png"] = rendered(item.canvas, "png")
                if block.kind == "figure":
                    drawings[item.name] = inline(item, svg, f"f{len(drawings)}")
        if self.name == "report":
            for name, frame in plots(results).items():
                files[f"plots/{name}.csv"] = csv(frame).encode()
            files[METRICS] = headlines(results)
        if answer:
            files["tables/answer.md"] = markdown(answer).encode()
        files["index.html"] = self.html(parts, answer, drawings, results, picture).encode()
        for place, data in files.items():
            atomically(folder / place, partial(_write, data))
        for kind in ("tables", "figures", "plots"):
            for path in (folder / kind).glob("*"):
                if f"{kind}/{path.name}" not in files:
                    path.unlink()

    def html(
        self,
        parts: list[FilledSection],
        answer: FilledSection | None,
        drawings: dict[str, Markup],
        results: Results,
        picture: FilledSection | None = None,
    ) -> str:
        """The HTML of the page; ``drawings``: its figures as SVG elements, by name."""
        environment = Environment(
            loader=PackageLoader("isi.report"),
            autoescape=select_autoescape(),
            undefined=StrictUndefined,
            trim_blocks=True,
            lstrip_blocks=True,
        )
        blocks, ids = _blocks(parts, answer), {part.id for part in parts}
        ids |= {f"{b.kind}-{b.content.name}" for b in blocks if b.kind in _NAMED}
        ids |= {term.id for block in blocks if block.kind == "terms" for term in block.content}
        terms = [*glossary.of_the_page(), *glossary.of_models(results)]
        marker = glossary.Marker([term for term in terms if term.id in ids])
        places = {title: place for title, place in PAGES["paper"].items() if place in ids}
        return environment.get_template("page.html").render(
            page=PAGES[self.name],
            answer=answer,
            picture=picture,
            question=words.question,
            places=places,
            figures=drawings,
            in_words=in_words,
            marker=marker,
            groups=[
                (name, list(group)) for name, group in groupby(parts, key=lambda part: part.group)
            ],
            prose=partial(marked_up, MARKDOWN.render, marker, ids),
            line=partial(marked_up, MARKDOWN.renderInline, marker, ids),
            header=header,
            column_groups=column_groups,
            best_rows=best_rows,
            forms=_FORMS,
            foot=foot(
                results,
                headlines(results) if self.name == "report" else None,
                PAGES[self.name].get("foot", PAGES["foot"]),
            ),
            json=lambda data: htmlsafe_json_dumps(data, separators=(",", ":")),
        )


def inline(figure: Figure, svg: str, name: str) -> Markup:
    """A figure as elements of the page, from the SVG of its canvas;
    ``name`` makes its ids unique within the page.
    """
    if figure.chart is None:
        return figures.inline(svg, name)
    narrow = figure.chart.narrow
    svgs = [svg, rendered(narrow, "svg").decode()] if narrow else [svg]
    return charts.inline(svgs, name)


#: Of Markdown, what the report's texts use; all else is text.
MARKDOWN = MarkdownIt("zero").enable(["list", "link", "backticks", "emphasis"])


def _blocks(parts: Iterable[FilledSection], answer: FilledSection | None) -> list[Block]:
    shown = [*parts, answer] if answer else parts
    return [block for part in shown for block in part.blocks]


def _write(data: bytes, path: Path) -> None:
    path.write_bytes(data)


_LINK = r"\[([^\]]+)\]\([^)\s]+\)"
#: Kinds of blocks that can be linked to by their names; the files of tables and figures.
_NAMED = ("table", "figure")
_FORMS = {
    "tables": [("csv", "CSV"), ("md", "Markdown"), ("tex", "LaTeX")],
    "figures": [("svg", "SVG"), ("png", "PNG")],
}
#: By column: which value is the best.
_BEST: dict[str, Any] = dict.fromkeys(
    [*HALVES.values(), *stats.DIRECTIONS.values(), "all", "novel"], max
)
_BEST["mean"] = _BEST["median"] = min  # epochs to convergence


def markdown(section: FilledSection) -> str:
    """The lists of a section in Markdown, without links:
    the README and the docs have these sentences, too.
    """
    lines = [line for block in section.blocks for line in block.text.splitlines()]
    unlinked = re.sub(rf" \({_LINK}\)", "", "\n".join(line for line in lines if line[:2] == "- "))
    return re.sub(_LINK, r"\1", unlinked) + "\n"


def marked_up(
    render: Callable[[str], str], marker: glossary.Marker, ids: Collection[str], text: str
) -> Markup:
    """Markdown as HTML with its terms marked; a link to an absent section is text."""
    html = render(_ABSENT.sub("–", text))

    def link(place: re.Match[str]) -> str:
        return place[0] if place[1] in ids else place[2]

    linked = re.sub(r'<a href="#([^"]+)">(.*?)</a>', link, html)
    linked = re.sub(r"(?<=\d) %", "\N{NO-BREAK SPACE}%", linked)
    return Markup(marker.text(linked))  # noqa: S704


def headlines(results: Results) -> bytes:
    """The file of the headline numbers."""
    return f"{json.dumps(metrics(results), indent=2)}\n".encode()


def foot(results: Results, numbers: bytes | None, paragraphs: Sequence[str]) -> list[str]:
    """Paragraphs at the foot of a page, such as the paper, the sources and the run, the licence;
    ``numbers``: the file of its headline numbers, whose SHA-256 it names.

    No commit and no time of the run: equal results make equal pages, also in a later commit.
    """
    cases = [runs.case.title for runs in results.readings.values()]
    used = [experiment.settings.graph for experiment in results.experiments.values()]
    extended = [graph.extend.source for graph in used if graph.extend]
    names = [*(graph.source for graph in used), *extended]
    recorded = {
        name: text.format(procthor=version("procthor")) for name, text in PAGES["recorded"].items()
    }
    titles = [recorded.get(name, name) for name in dict.fromkeys(names)]
    about = {"sources": joined(titles or cases), "numbers": ""}
    if numbers:
        digits = hashlib.sha256(numbers).hexdigest()[:12]
        about["numbers"] = f"SHA-256 of [the headline numbers]({METRICS}): {digits}. "
    return [text.format(**about) for text in paragraphs]


def best_rows(table: ReportTable) -> dict[int, set[int]]:
    """The rows with the best value of each column of ``_BEST``, without the joint model's;
    only if rows are models.
    """
    if sum(table.is_text) != 1:
        return {}
    best, texts, joint = {}, table.texts, label(JOINT)
    for place, column in enumerate(table.columns):
        cells = {number: row[place] for number, row in enumerate(table.rows) if row[0] != joint}
        means = {number: cell.mean for number, cell in cells.items() if isinstance(cell, Estimate)}
        if column.name in _BEST and len(means) > 1:
            shown = texts[_BEST[column.name](means, key=means.get)][place][0]
            best[place] = {number for number in means if texts[number][place][0] == shown}
    return best


def header(column: Column) -> str:
    """The header of a column on the page, without that of its group."""
    return column.title or WORDS.get(column.name, column.name)


def column_groups(table: ReportTable) -> list[tuple[str, int]]:
    """Title and number of columns of each group of neighbouring columns;
    empty if no column has a group.
    """
    shown = groupby(column.group for _, column, _ in table.layout)
    groups = [(WORDS.get(name, name), len(list(columns))) for name, columns in shown]
    return groups if any(name for name, _ in groups) else []


def metrics(results: Results) -> dict[str, Any]:
    """Headline numbers for ``dvc metrics``: the first experiment's,
    and each other one's under its name.
    """
    first, *others = results.experiments.values()
    return _rounded(_headlines(first) | {other.name: _headlines(other) for other in others})


def _headlines(experiment: Experiment) -> dict[str, Any]:
    numbers: dict[str, Any] = {
        "immediate_mrr_star": experiment.mrr_star,
        "epochs_to_convergence": experiment.epochs(),
        "unconverged_percent": experiment.unconverged,
    }
    if experiment.settings.graph.extend is None:
        graph = {
            "observations": int(experiment.triples["count"].sum()),
            "unique_triples": len(experiment.triples),
            "entities": len(experiment.entities),
        }
        shown = {}
        for scope in ("all", "novel"):
            gains = stats.values(stats.improvements(experiment.immediate, scope))
            others = gains.keys() - {BASELINE, JOINT}
            shown[scope] = {name: gain for name, gain in gains.items() if name in others}
        numbers = {"graph": graph, **numbers, "improvement_over_xavier_percent": shown}
    else:
        drops = finetuning.interference_percent(experiment.immediate)
        last = where(experiment.curves, scope="known_closed", epoch=experiment.max_epochs)
        numbers["drop_percent"] = stats.values(drops)
        numbers["known_closed_at_the_end"] = stats.means(last, "mrr_star")
    if experiment.queries is not None:
        numbers["novel_entity_given"] = stats.values(experiment.given_means)
    if "affordances" in experiment.analyses:
        numbers["affordances_percent"] = queries.AffordanceAnswers.of(experiment).shares
    return numbers


def _rounded(values: dict[str, Any]) -> dict[str, Any]:
    """Values rounded as in all files (``number``), without nulls."""
    rounded = {
        name: _rounded(value) if isinstance(value, dict) else number(value)
        for name, value in values.items()
    }
    return {
        name: value
        for name, value in rounded.items()
        if isinstance(value, dict) or not pd.isna(value)
    }


def plots(results: Results) -> dict[str, pd.DataFrame]:
    """Curves for ``dvc plots``, by file name: means of MRR* × 100 by size or epoch,
    a column for each initializer.
    """
    initializers = list(results.params.initializers)
    # dvc.yaml names these plots, also without the experiment
    nothing = pd.DataFrame(columns=["epoch", *initializers])
    frames = {"transfer_known": nothing, "transfer_known_closed": nothing}
    for experiment in results.experiments.values():
        name = f"{experiment.name}_{{}}"
        if experiment in results.standalone:
            groups = experiment.immediate.groupby(["scope", "size", "model"])
            means = 100 * groups["mrr_star"].mean().unstack("model")
            means = means.reindex(columns=list(dict.fromkeys([*means.columns, *initializers])))
            for scope in ("all", "novel"):
                rows = means[means.index.get_level_values("scope") == scope]
                frames[f"immediate_{scope}{experiment.suffix}"] = rows.droplevel(0).reset_index()
            name = f"curves_{{}}{experiment.suffix}"
        runs = experiment.curves[experiment.curves["model"] != JOINT]
        for scope in ("all", "novel_heldout", "known", "known_closed"):
            groups = where(runs, scope=scope).groupby(["epoch", "model"])
            rows = 100 * groups["mrr_star"].mean().unstack("model").reindex(columns=initializers)
            frames[name.format(scope)] = rows.reset_index()
    return frames
