/* What the vectors answer: a summary, indicators, and answers with rank and mark, side by side with the joint model. */
import { at, fixed, html } from "./elements.js";
import { dialOf } from "./state.js";
import { insertion, queriesOf, relationalRanks } from "./insertion.js";
import { RANDOM } from "./initializers.js";

/** @import { Fact, Subject, World } from "./data.js" */
/** @import { Insertion, Query } from "./insertion.js" */
/** @import { Choice, State } from "./state.js" */

const FIRST = 6, MOST_ROWS = 18, MOST_TRUE = 8, LEAST_QUERIES = 4;

/** @param {World} world @param {State} state @param {Insertion[]} shown @param {(id: number) => void} point */
export function drawAnswers(world, state, shown, point) {
  const { subject, given, choices } = state;
  const labels = choices.map(({ name }) => world.initializers.find((one) => one.name === name)?.label ?? name);
  const joint = subject.id < 0 ? [] : [insertion(world, subject, given, null)];
  const names = [...labels, ...joint.map(() => "Joint model")], columns = [...shown, ...joint];
  drawSummary(world, state, columns, names);
  at("indicators", HTMLElement).replaceChildren(...shown.map((one, number) =>
    indicatorTable(world, state, one, labels[number], number, point)));
  const groups = queriesOf(world, subject).map((query) => ({ query, node: html("div", { class: "ex-query" },
    html("h4", {}, asked(world, query, subject.name, "?")),
    html("div", { class: "ex-columns" }, ...columns.map((one, number) => answerList(world, state, query, one, names[number], number)))) }));
  const answered = groups.filter(({ query }) => query.true.size).length, least = answered && subject.id >= 0 ? 0 : LEAST_QUERIES;
  const open = Math.max(answered, least);
  const nodes = groups.map(({ node }) => node), vain = nodes.slice(open);
  at("answers", HTMLElement).replaceChildren(...nodes.slice(0, open));
  if (vain.length) {
    const folded = document.querySelector("#explorer-box .ex-vain"), text = answered ? "Questions without a true answer" : "More questions";
    const others = html("details", { class: "ex-vain" }, html("summary", {}, text), ...vain);
    others.open = folded instanceof HTMLDetailsElement && folded.open;
    at("others", HTMLElement).replaceChildren(others);
  } else at("others", HTMLElement).replaceChildren();
}

/** @param {World} world @param {Query | {relation: number, isTail: boolean}} query @param {string} own
 * @param {string} other */
export function asked(world, { relation, isTail }, own, other) {
  return (isTail ? [other, world.relations[relation], own] : [own, world.relations[relation], other]).join(" ");
}

/** @param {World} world @param {State} state @param {Insertion[]} columns @param {string[]} names */
function drawSummary(world, { subject, choices }, columns, names) {
  const test = subject.facts.filter((_, place) => !subject.offered.includes(place)), tests = test.length;
  for (const part of ["numbers", "name"]) at(part, HTMLElement).hidden = !tests;
  at("numbers", HTMLElement).replaceChildren(...(tests ? columns : []).map(({ mrrStar }, number) => {
    const name = choices[number]?.name, about = RANDOM.includes(name) ? drawn(world, subject, choices[number]) : "";
    return html("div", { class: style(number) }, html("dt", {}, names[number]),
      html("dd", {}, html("strong", {}, mrrStar === null ? "–" : fixed(100 * mrrStar, 1)), about));
  }));
  at("name", HTMLElement).textContent = "MRR* of this insertion";
  at("status", HTMLElement).textContent = tests
    ? `Over the test ${tests === 1 ? "fact" : `set, ${tests} facts`} of ${subject.name} that ${tests === 1 ? "is" : "are"} never offered, with the other end `
      + "hidden among all known entities; 100 is perfect. What you give changes the vector, never the test set."
      + (columns.length > 2 ? ` The joint model was trained with ${test.filter(({ split }) => !split).length} of them.` : "")
    : `${subject.name} has no fact but those that you may give, so that no answer can be tested.`;
  at("lengths", HTMLElement).textContent = `Distance from the centre: ${columns.map(({ place }, number) => `${names[number]} ${fixed(place[0], 1)}`).join(", ")}.`;
}

/** @param {World} world @param {Subject} subject @param {Choice} choice */
const drawn = (world, { id }, { name, dial }) => (name === "xavier" && dial === 1 && world.random.has(id) ? "the median of 50 draws" : `draw ${dial}`);

/** What changed since ``before``, and MRR* now, in words that are read out. @param {World} world @param {State} state
 * @param {Insertion[]} shown @param {State} before */
export function summaryOf(world, { subject, given, choices }, shown, before) {
  const labelled = choices.map(({ name }, number) => {
    const range = dialOf(world, name), label = world.initializers.find((one) => one.name === name)?.label ?? name;
    return range ? `${label}, ${range.label} ${choices[number].dial}` : label;
  });
  const changes = choices.flatMap((choice, number) => (choice === before.choices[number] ? [] : [`now ${labelled[number]}`]));
  const added = given.filter((place) => !before.given.includes(place)), removed = before.given.filter((place) => !given.includes(place));
  if (subject !== before.subject) changes.push(`${subject.name}, ${given.length} facts given`);
  else if (added.length || removed.length) {
    const [place] = [...added, ...removed], fact = subject.facts[place], words = asked(world, fact, subject.name, world.names[fact.other]);
    changes.push(added.length + removed.length > 1 ? `${given.length} facts given` : `${words}: ${added.length ? "given" : "not given"}`);
  }
  const values = shown.map(({ mrrStar }, number) => `${labelled[number]}: ${mrrStar === null ? "none" : fixed(100 * mrrStar, 1)}`);
  return `${changes.join("; ")}. MRR*: ${values.join("; ")}.`;
}

/** @param {number} number */
const style = (number) => ["ex-first", "ex-second", "ex-third"][number];

/** @param {World} world @param {State} state @param {Insertion} one @param {string} label @param {number} number
 * @param {(id: number) => void} point */
function indicatorTable(world, { subject, given, choices }, one, label, number, point) {
  const heading = html("h4", {}, label), total = one.weights?.filter(Boolean).length ?? 0;
  if (!one.weights) return html("div", { class: style(number) }, heading, html("p", {}, "Random: it has no indicators."));
  if (!one.indicators.length) {
    const lack = !one.fallback ? "By its definition" : subject.cosines ? "No fact" : given.length ? "No word for it" : "No word for it, no fact";
    return html("div", { class: style(number) }, heading, html("p", {}, `${lack}: the mean of all ${total} known entities.`));
  }
  const ranks = relationalRanks(world, subject, given);
  /** @param {number} id how near it is */
  const near = (id) => (ranks && choices[number].name !== "es" ? -(ranks.get(id) ?? 0) : subject.cosines?.[id] ?? 0);
  const order = one.indicators.slice().sort((a, b) => near(b) - near(a));
  const rows = order.slice(0, MOST_ROWS).map((id) => {
    const row = html("tr", { "data-entity": id }, html("th", { scope: "row" }, world.names[id]),
      html("td", {}, subject.cosines && world.worded[id] ? fixed(subject.cosines[id], 2) : "–"),
      html("td", { class: "ex-extra" }, ranks ? String(ranks.get(id)) : "–"));
    row.addEventListener("pointerenter", () => point(id));
    row.addEventListener("pointerleave", () => point(-1));
    return row;
  });
  const heads = ["entity", "words", "relations"]
    .map((head) => html("th", { scope: "col", ...(head === "relations" ? { class: "ex-extra" } : {}) }, head));
  const table = html("table", {}, html("caption", { class: "hidden" }, `Indicators of ${label}`),
    html("thead", {}, html("tr", {}, ...heads)), html("tbody", {}, ...rows));
  const notes = total > rows.length ? [html("p", {}, `${total} entities in all.`)] : [];
  if (one.fallback) notes.push(html("p", {}, `For lack of data it uses ${one.fallback}.`));
  return html("div", { class: style(number) }, heading, table, ...notes);
}

/** @param {World} world @param {State} state @param {Query} query @param {Insertion} one @param {string} label
 * @param {number} number */
function answerList(world, { subject, given }, query, one, label, number) {
  const order = one.answers(query);
  const lines = order.flatMap((id, place) => {
    const fact = query.true.get(id);
    return place < FIRST || fact !== undefined ? [{ id, rank: place + 1, fact }] : [];
  });
  const shown = lines.slice(0, FIRST + MOST_TRUE), rest = lines.length - shown.length;
  return html("div", { class: style(number) }, html("p", { class: "ex-by" }, label), html("ol", {}, ...shown.map(({ id, rank, fact }) => {
    const words = fact === undefined ? [world.names[id]]
      : [html("strong", {}, `✓ ${world.names[id]}`), " ", markOf(subject, given, fact)];
    return html("li", { value: rank, "data-entity": id }, ...words);
  })), ...(rest ? [html("p", {}, `and ${rest} more true ones below`)] : []));
}

/** @param {Subject} subject @param {number[]} given @param {number} fact its place */
function markOf({ offered }, given, fact) {
  if (given.includes(fact)) return html("span", { class: "ex-mark ex-given" }, "given");
  return html("span", { class: offered.includes(fact) ? "ex-mark" : "ex-mark ex-held" }, offered.includes(fact) ? "not given" : "test");
}
