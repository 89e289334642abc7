"""The explorer of the page, in a real browser, against Python:
vectors, indicators, scores and MRR*.
"""

from __future__ import annotations

import base64
import os
from collections.abc import Callable, Iterator
from contextlib import chdir
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import torch
from numpy.random import Generator

from isi.evaluation.ranking import make_queries, padded_ids, rank_queries
from isi.graph.sessions import OUT, TEST, TRAIN, VALID, Session, membership, touches
from isi.initializers.api import INITIALIZERS, InitResult
from isi.initializers.context import InitContext, context_in_session
from isi.models.stack import Embedding
from stages.check_params import load
from stages.demonstrate import COMPUTED, DRAWS, Explored, draws, median_draw, picture
from stages.grid import GridPoints
from stages.params import StageParams
from stages.store import Store, model_of
from tests.browser import Opened, opened
from tests.small_explorer import NAMES, Shown, scores, small

if TYPE_CHECKING:
    from playwright.sync_api import Browser

ROOT = Path(__file__).parent.parent
#: A folder with the outputs of the pipeline: the explorer of its run is tested, too.
RUN = Path(os.environ.get("ISI_RUN", ROOT))
#: Of a run's known entities, each so-manyth is compared, and of small graphs all; 1: each one, in
#: about 80 seconds.
EVERY = int(os.environ.get("ISI_EVERY", 12))
DRAWN = ("xavier", "iu")  #: Initializers that draw.
CASES = """cases => cases.map(({entity, given, name, dial}) => {
  const {world, subjectOf, insertion} = window.explorer, subject = subjectOf(world, entity);
  const places = subject.facts.flatMap(({triple}, place) => given.includes(triple) ? [place] : []);
  const one = insertion(world, subject, places, name && {name, dial});
  const scores = world.relations.map((_, relation) =>
    [false, true].map((isTail) => [...one.scoreOf(relation, isTail)]));
  return {vector: [...one.vector], weights: one.weights && [...one.weights], mrrStar: one.mrrStar, \
place: one.place, scores};
})"""
STATE = """(({subject, given, choices}) => [subject.name, subject.facts.length, given, choices])(
  explorer.state())"""


def of_run() -> Shown:
    with chdir(RUN):
        known, store = load(), Store("ai2thor")
        chosen = known.explorer
        explored = Explored.read(store, model_of(StageParams.load()), chosen.size, chosen.seed)
        assert explored is not None
        fraction = known.sessions.insert_fraction
        kinds = store.entities()["kind"]
        return Shown(explored, kinds, known.initializers, known.seed, fraction)


@pytest.fixture(scope="module", params=["small", "run"])
def shown(request: pytest.FixtureRequest) -> Shown:
    if request.param == "small":
        return small()
    if not (RUN / "data/embeddings/ai2thor/joint.safetensors").exists():
        pytest.skip("the pipeline has not run")
    return of_run()


@pytest.fixture
def found(chromium: Browser, shown: Shown, tmp_path: Path) -> Iterator[Opened]:
    with opened(chromium, shown.write(tmp_path / "index.html")) as opened_page:
        yield opened_page
        assert opened_page.errors == opened_page.requests == []


# Python's side: one entity is inserted, alone, into Θ⁰ without it


def alone(points: GridPoints, entity: int) -> tuple[Session, Session]:
    """The sessions before and after the insertion of one entity into D⁰ without it."""
    before = points.session(0).entities.clone()
    before[0, entity] = False
    after = before | membership(torch.tensor([[entity]]), before.shape[1])

    def session(entities: torch.Tensor) -> Session:
        inside = entities[:, points.graph.triples[:, 0]] & entities[:, points.graph.triples[:, 2]]
        return Session(
            points.graph, entities, torch.as_tensor(points.splits).masked_fill(~inside, OUT)
        )

    return session(before), session(after)


def inserted(shown: Shown, entity: int, given: list[int], name: str, dial: int) -> InitResult:
    """An initializer's result, from the facts ``given``;
    ``dial``: k, or the number of the page's draw.
    """
    explored, points = shown.explored, shown.explored.points
    without = explored.theta0.entity.clone()
    without[0, entity] = 0
    rows = torch.tensor([[0, 0, triple] for triple in sorted(given)], dtype=torch.int64)
    context = context_in_session(
        replace(explored.theta0, entity=without),
        alone(points, entity)[0],
        torch.tensor([[entity]]),
        rows.reshape(-1, 3),
        torch.as_tensor(explored.words),
        shown.root,
        points.keys(),
    )
    options = dict(shown.options[name])
    if "k" in options:
        options["k"] = dial
    parts = {field.name: getattr(context, field.name) for field in fields(context)}
    drawn = DrawnByPage(**parts, entity=points.graph.entities[entity], number=dial)
    result = INITIALIZERS.get(name, name).initialize(drawn, options)
    if (name, dial) == ("xavier", 1) and entity in explored.novel:
        first = median_draw(explored, entity, draws(explored))
        return replace(result, vectors=torch.as_tensor(first).reshape(1, 1, -1))
    return result


@dataclass(frozen=True)
class DrawnByPage(InitContext):
    """A context whose random numbers are those of the page."""

    entity: str = ""
    number: int = 1

    def draw(
        self, purpose: str, distribution: Callable[[Generator, tuple[int, int]], np.ndarray]
    ) -> torch.Tensor:
        assert distribution is Generator.random
        size = self.theta0.entity.shape[-1]
        return torch.tensor([[uniform(purpose, self.entity, self.number, size)]]).float()


def uniform(initializer: str, entity: str, draw: int, size: int) -> list[float]:
    """The page's random numbers: mulberry32 from FNV-1a of a text."""
    bits = 0x811C9DC5
    for byte in f"{initializer} {draw} {entity}".encode():
        bits = (bits ^ byte) * 0x01000193 % 2**32
    numbers = []
    for _ in range(size):
        bits = (bits + 0x6D2B79F5) % 2**32
        mixed = (bits ^ bits >> 15) * (bits | 1) % 2**32
        mixed ^= (mixed + (mixed ^ mixed >> 7) * (mixed | 61)) % 2**32
        numbers.append((mixed ^ mixed >> 14) / 2**32)
    return numbers


def mrr_star(
    points: GridPoints, embedding: Embedding, entity: int, offered: list[int]
) -> float | None:
    """MRR* over the true triples that are not offered,
    with the entity given and the other end hidden.
    """
    before, after = alone(points, entity)
    told = torch.zeros(1, len(points.graph.triples), dtype=torch.bool)
    told[0, offered] = True
    of = touches(points.graph, membership(torch.tensor([[entity]]), len(points.graph.entities)))
    loop = points.graph.triples[:, 0] == points.graph.triples[:, 2]
    queried = after.members(TRAIN, VALID, TEST) & of & ~told & ~loop
    if not queried.any():
        return None
    filtered = (after.members(TRAIN, VALID) & ~of) | told
    queries = make_queries(after, padded_ids(queried), queried, filtered, filtered, before.entities)
    (ranked,) = rank_queries(embedding, {"all": queries})
    head, _, tail = ranked["all"].slots
    is_tail = ranked["all"].rows.ids[2] == entity
    closeness = torch.where(is_tail, head.closeness, tail.closeness)
    weight = 2 * ranked["all"].rows.entity_weight[:, : closeness.shape[1]]
    return float((weight * closeness).sum() / weight.sum())


def cases(shown: Shown, data: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Insertions with all offered facts and with some; ``name`` None: the joint model's vector."""
    points, rng = shown.explored.points, np.random.default_rng(0)
    everyone = np.flatnonzero(points.session(1).entities[0]).tolist()
    step = EVERY if len(everyone) > len(NAMES) else 1
    for entity in everyone:
        if entity not in points.novel and entity % step:
            continue
        offered = data["given"][str(entity)]
        some = sorted(rng.permutation(offered)[: rng.integers(len(offered) + 1)].tolist())
        yield {"entity": entity, "given": some, "name": None, "dial": 0}
        for name in COMPUTED:
            usual, other = shown.options[name].get("k", 1), int(rng.integers(2, 6))
            dials = {usual, other} if name in DRAWN or "k" in shown.options[name] else {usual}
            for given in (offered, some):
                for dial in dials:
                    yield {"entity": entity, "given": given, "name": name, "dial": dial}


def test_vectors_indicators_scores_and_mrr_star_are_pythons(found: Opened, shown: Shown) -> None:
    explored, data = shown.explored, shown.data
    rounded = np.frombuffer(base64.b64decode(data["joint"]), "<i2") * data["jointScale"]
    joint = torch.as_tensor(rounded, dtype=torch.float32).reshape(explored.joint.entity.shape)
    listed = list(cases(shown, data))
    for case, answer in zip(listed, found.page.evaluate(CASES, listed), strict=True):
        entity, name = case["entity"], case["name"]
        embedding = replace(explored.joint, entity=joint)
        if name:
            result = inserted(shown, entity, case["given"], name, case["dial"])
            vector, table = result.vectors[0, 0], explored.theta0.entity.clone()
            assert np.allclose(answer["vector"], vector, rtol=0, atol=1e-4), case
            place = explored.projection.places(vector.double().numpy())
            assert np.allclose(answer["place"], place, rtol=0, atol=1e-3), case
            assert (answer["weights"] is None) == (result.weights is None)
            if result.weights is not None:
                assert np.allclose(answer["weights"], result.weights[0, 0], rtol=0, atol=1e-4), case
            table[0, entity] = vector
            embedding = replace(explored.theta0, entity=table)
        assert np.allclose(answer["scores"], scores(embedding, entity), rtol=1e-4, atol=1e-4), case
        offered = data["given"][str(entity)]
        expected = mrr_star(explored.points, embedding, entity, offered)
        assert answer["mrrStar"] == pytest.approx(expected, abs=1e-4), case


def test_test_facts_are_never_offered_and_what_is_given_changes_the_vector_alone(
    found: Opened, shown: Shown
) -> None:
    offered = found.page.evaluate("""() => explorer.world.novel.map((id) => {
      const {offered, facts} = explorer.subjectOf(explorer.world, id);
      return [offered.length, facts.filter(({split}) => split === 0).length, facts.length];
    })""")
    assert all(given <= max(trained / 2, 1) and given <= every for given, trained, every in offered)
    ticks = found.page.locator("#explorer-facts input")
    assert ticks.count() == offered[shown.data["novel"].index(shown.data["start"])][0]
    found.page.get_by_label("First initializer").select_option("Xavier")  # it reads no facts
    before = numbers(found)
    ticks.first.click()
    assert numbers(found) == before


def test_the_picture_and_the_explorer_have_the_same_random_start(
    found: Opened, shown: Shown
) -> None:
    drawn = picture(shown.explored, shown.options)
    assert drawn
    found.page.get_by_label("Second initializer").select_option("Xavier")
    found.page.locator("#explorer-more summary").click()
    away, name = f"Xavier {drawn['map']['random'][0]:.1f}", drawn["name"]
    assert away in found.page.locator("#explorer-lengths").inner_text()
    assert f"the median of {DRAWS} draws" in found.page.locator("#explorer-numbers").inner_text()
    for question in drawn["questions"]:
        asked = found.page.get_by_text(f"{name} {question['relation']} ?", exact=True)
        lines = found.page.locator(".ex-query", has=asked).locator(".ex-second li")
        for line, (answer, right) in zip(lines.all(), question["random"], strict=False):
            assert line.inner_text().startswith(f"✓ {answer}" if right else answer)


# What is shown


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return small().write(tmp_path_factory.mktemp("report") / "index.html")


def numbers(found: Opened) -> list[str]:
    return found.page.locator("#explorer-numbers strong").all_inner_texts()


def shows(found: Opened, part: str, text: str) -> bool:
    return text in found.page.locator(f"#explorer-{part}").inner_text()


def test_choices_stand_in_the_address_and_come_back_from_it(
    chromium: Browser, report: Path
) -> None:
    with opened(chromium, report) as found:
        control, started = found.page.get_by_label, numbers(found)
        control("New entity").select_option(NAMES[small().explored.novel[-1]])
        found.page.locator("#explorer-more summary").click()
        control("First initializer").select_option("RS")
        found.page.locator("#explorer-dial-0").focus()
        found.page.keyboard.press("ArrowLeft")
        control("Second initializer").select_option("IU")
        found.page.locator("#explorer-again-1").click()
        before = found.page.evaluate(STATE)
        assert before[3] == [{"name": "rs", "dial": 3}, {"name": "iu", "dial": 2}]
        address = found.page.evaluate("location.hash").removeprefix("#")
        with opened(chromium, report, fragment=address) as again:
            assert again.page.evaluate(STATE) == before
            assert numbers(again) == numbers(found) != started
            assert again.errors == []
        found.page.evaluate("location.hash = '#explorer/no such/thing/xavier~x/8.9.77/1.1.99'")
        found.page.evaluate("location.hash = '#else'")
        assert found.page.evaluate(STATE)[0] == before[0]
        assert found.errors == []


def test_facts_of_ones_own_stay_as_they_are_ticked_until_they_are_removed(
    chromium: Browser, report: Path
) -> None:
    with opened(chromium, report, fragment="explorer/+tea cup/ers/xavier//") as found:
        assert numbers(found) == []  # there is no test fact
        assert found.page.locator("#explorer-answers li").first.is_visible()
        ticks = found.page.locator("#explorer-facts input")
        for end in (0, 1, 1):  # the last one is there already
            found.page.get_by_label("Other entity").select_option(index=end)
            found.page.get_by_role("button", name="Add").click()
        ticks.first.uncheck()
        marks = found.page.locator("#explorer-answers .ex-first .ex-mark").all_inner_texts()
        assert sorted(marks) == ["given", "not given"]
        found.page.get_by_label("New entity").select_option("own")
        found.page.get_by_label("Its name").fill("tea cups")
        assert found.page.evaluate(STATE)[:3] == ["tea cups", 2, [1]]
        address = found.page.evaluate("location.hash").removeprefix("#")
        with opened(chromium, report, fragment=address) as again:
            assert again.page.evaluate(STATE) == found.page.evaluate(STATE)
        found.page.get_by_role("button", name="Remove").first.click()
        assert found.page.evaluate(STATE)[1:3] == [1, [0]]
        assert ticks.evaluate_all("all => all.map(one => one.checked)") == [True]
        assert found.errors == []


def test_only_what_a_relations_end_has_had_is_offered_and_ranked(
    chromium: Browser, report: Path
) -> None:
    explored = small().explored
    with opened(chromium, report, fragment="explorer/+tea cup/ers/xavier//") as found:
        found.page.locator("#explorer-more summary").click()
        for is_tail in (False, True):
            found.page.get_by_label("Direction").select_option(str(int(is_tail)))
            for relation, name in enumerate(explored.points.graph.relations):
                had = {NAMES[each] for each in explored.candidates((relation, is_tail))}
                found.page.get_by_label("Relation", exact=True).select_option(str(relation))
                options = found.page.locator("#explorer-own-other option").all_text_contents()
                assert {*options} == had
                asked = f"? {name} tea cup" if is_tail else f"tea cup {name} ?"
                query = found.page.locator(".ex-query", has=found.page.get_by_text(asked))
                assert {*query.locator("li").all_text_contents()} <= had


def test_answers_are_marked_and_never_the_entity_itself(chromium: Browser, report: Path) -> None:
    with opened(chromium, report) as found:
        name, facts, given, _ = found.page.evaluate(STATE)
        texts = found.page.locator(".ex-query li").all_text_contents()
        assert not any(text.removeprefix("✓ ").startswith(name) for text in texts)
        marks = found.page.locator("#explorer-answers .ex-first .ex-mark").all_inner_texts()
        assert sorted(marks) == ["given"] * len(given) + ["test"] * (facts - len(given))
        for ranks in found.page.locator(".ex-query ol").all():
            places = [int(item.get_attribute("value") or 0) for item in ranks.locator("li").all()]
            assert places == sorted({*places})


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("mugs", "nearest known phrase, “mug”"),
        ("frying-pan", "nearest known phrase, “pan”"),
        ("wooden shelves", "nearest known phrase, “shelf”"),
        ("top cup", "nearest known phrase, “cup”"),  # not table top: the last word counts first
        ("cup holder", "A guess: no known phrase ends in its last word"),
        ("scale", "no word vector"),
        ("sofa", "is known already"),
        ("Bottle", "choose it"),
    ],
)
def test_what_is_known_of_a_name_is_said(
    chromium: Browser, report: Path, name: str, words: str
) -> None:
    with opened(chromium, report, fragment=f"explorer/+{name}/es/xavier//") as found:
        assert shows(found, "about", words)
        if name == "scale":
            assert shows(found, "indicators", "No word for it, no fact: the mean of all")
        assert found.errors == []


def test_an_indicator_is_marked_on_the_map_and_arrows_name_its_points(
    chromium: Browser, report: Path
) -> None:
    with opened(chromium, report, fragment="explorer/bottle/es/xavier") as found:
        row = found.page.locator("#explorer-indicators tbody th").first
        name, pointed = row.inner_text(), found.page.locator("#explorer-map-name")
        row.hover()
        assert pointed.inner_text().startswith(name)
        assert found.page.locator(".ex-dot.ex-lit").count() == 1
        assert found.page.locator(".ex-lines .ex-first").count() == 3
        assert name in found.page.locator(".ex-labels text").all_text_contents()
        found.page.locator("#explorer-map").focus()
        found.page.keyboard.press("ArrowRight")
        first = pointed.inner_text()
        found.page.keyboard.press("ArrowRight")
        assert first
        assert pointed.inner_text() != first


def test_a_change_is_read_out(chromium: Browser, report: Path) -> None:
    with opened(chromium, report) as found:
        live = found.page.locator("#explorer-changed[role=status]")
        assert live.inner_text() == ""
        found.page.locator("#explorer-facts input").first.click()
        live.get_by_text(": not given.").wait_for()
        found.page.get_by_label("Second initializer").select_option("RS")
        live.get_by_text("now RS").wait_for()
        assert all(value in live.inner_text() for value in numbers(found)[:2])


def test_initializers_and_map_stay_in_sight(chromium: Browser, report: Path) -> None:
    for width, part in ((1280, "#explorer-map"), (390, ".ex-controls")):
        with opened(chromium, report, width=width) as found:
            found.page.locator("#explorer-answers .ex-query").last.scroll_into_view_if_needed()
            box = found.page.locator(part).bounding_box()
            assert box
            assert 0 <= box["y"] < box["y"] + box["height"] <= 900
            stops = "all => all.filter((one) => one.checkVisibility()).length"
            controls = found.page.locator("#explorer-box :is(select, button, input, summary, svg)")
            assert controls.evaluate_all(stops) <= 12


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [390, 1280])
def test_nothing_sticks_out_and_texts_are_large_enough(
    chromium: Browser, report: Path, width: int, scheme: str
) -> None:
    small = """all => all.filter((one) => one.checkVisibility()).map((one) => [one.textContent,
      parseFloat(getComputedStyle(one).fontSize) * one.getScreenCTM().a])
      .filter(([, size]) => size < 11.95)"""
    outside = """all => all.filter((one) => {
      const {left, right} = one.getBoundingClientRect();
      const place = one.ownerSVGElement.parentElement.getBoundingClientRect();
      return left < place.left - 1 || right > place.right + 1;
    }).map((one) => one.textContent)"""
    far = "explorer/bottle/ers/xavier"  # known vectors of so small a graph alone have long numbers
    with opened(chromium, report, width=width, scheme=scheme, fragment=far) as found:
        assert found.overflow == 0
        assert found.page.locator("svg text").evaluate_all(outside) == []
        assert found.page.locator("svg text").evaluate_all(small) == []
        assert found.errors == found.requests == []


def test_paper_and_readers_without_scripts_have_a_sentence(chromium: Browser, report: Path) -> None:
    for script in (True, False):
        with opened(chromium, report, script=script) as found:
            found.page.emulate_media(media="print")
            assert found.page.locator(".ex-paper").is_visible()
            assert not found.page.locator("#explorer-box").is_visible()
