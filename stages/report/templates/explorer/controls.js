/* Controls: the entity, its facts as boxes to tick, two initializers, and, under "More", what is rarely needed. */
import { asked } from "./answers_view.js";
import { candidates, nearestByName, ownSubject, subjectOf } from "./data.js";
import { at, html } from "./elements.js";
import { RANDOM } from "./initializers.js";
import { choiceOf, dialOf, factOf } from "./state.js";

/** @import { Fact, World } from "./data.js" */
/** @import { State } from "./state.js" */

const OF_READER = "own"; // value of the option

/** @param {World} world @param {(change: Partial<State>) => void} change @param {() => State} current */
export function makeControls(world, change, current) {
  const name = at("own-name", HTMLInputElement);
  const [entity, known, relation, side, other] = ["entity", "known", "own-relation", "own-side", "own-other"].map((id) => at(id, HTMLSelectElement));
  /** @param {number[]} ids */
  const byName = (ids) => ids.slice().sort((a, b) => world.names[a].localeCompare(world.names[b]))
    .map((id) => html("option", { value: id }, world.names[id]));
  entity.append(...byName(world.novel), html("option", { value: OF_READER }, "a name of your own …"));
  known.append(html("option", { value: "" }, "–"), ...byName(world.known));
  side.append(html("option", { value: 0 }, "new entity →"), html("option", { value: 1 }, "→ new entity"));

  /** Relations that have had known entities at the asked end, and these entities. */
  function offerFacts() {
    const isTail = side.value === "1", chosen = relation.value, before = ownSubject(world, "", []).before;
    const offered = world.relations.map((_, id) => candidates(before, { relation: id, isTail }));
    relation.replaceChildren(...world.relations.flatMap((text, id) => (offered[id].length ? [html("option", { value: id }, text)] : [])));
    if (offered[Number(chosen)]?.length && chosen) relation.value = chosen;
    other.replaceChildren(...byName(offered[Number(relation.value)]));
  }
  relation.addEventListener("change", offerFacts);
  side.addEventListener("change", offerFacts);
  offerFacts();

  let facts = /** @type {Fact[]} */ ([]), given = /** @type {number[]} */ ([]); // of the reader's own entity
  const insertOwn = () => change({ subject: ownSubject(world, name.value.trim() || "something", facts), given });
  /** @param {string} id */
  function insertKnown(id) {
    const subject = subjectOf(world, Number(id));
    change({ subject, given: subject.offered });
  }
  entity.addEventListener("change", () => (entity.value === OF_READER ? insertOwn() : insertKnown(entity.value)));
  known.addEventListener("change", () => insertKnown(known.value || String(world.start)));
  name.addEventListener("input", insertOwn);
  at("own-form", HTMLFormElement).addEventListener("submit", (event) => {
    event.preventDefault();
    const fact = factOf(Number(relation.value), side.value === "1", Number(other.value));
    if (facts.some((one) => asked(world, one, "", String(one.other)) === asked(world, fact, "", String(fact.other)))) return;
    given = [...given, facts.length];
    facts = [...facts, fact];
    insertOwn();
  });
  /** @param {number} removed its place */
  function remove(removed) {
    facts = facts.filter((_, place) => place !== removed);
    given = given.filter((place) => place !== removed).map((place) => place - Number(place > removed));
    insertOwn();
    const next = document.querySelector("#explorer-facts button");
    (next instanceof HTMLElement ? next : other).focus();
  }
  const columns = [0, 1].map((number) => {
    const by = at(`by-${number}`, HTMLSelectElement), dial = at(`dial-${number}`, HTMLInputElement), again = at(`again-${number}`, HTMLButtonElement);
    by.append(...world.initializers.map((one) => html("option", { value: one.name }, one.label)));
    /** @param {State["choices"][number]} choice */
    const choose = (choice) => change({ choices: current().choices.map((old, place) => (place === number ? choice : old)) });
    by.addEventListener("change", () => choose(choiceOf(world, by.value)));
    dial.addEventListener("input", () => choose({ name: by.value, dial: Number(dial.value) }));
    again.addEventListener("click", () => choose({ name: by.value, dial: current().choices[number].dial + 1 }));
    return { by, dial, again, label: at(`dial-label-${number}`, HTMLLabelElement), place: at(`dial-box-${number}`, HTMLElement) };
  });
  at("all", HTMLButtonElement).addEventListener("click", () => change({ given: current().subject.offered }));
  at("none", HTMLButtonElement).addEventListener("click", () => change({ given: [] }));

  /** @param {State} state */
  return function show(state) {
    const { subject, choices } = state, isOwn = subject.id < 0;
    entity.value = isOwn ? OF_READER : String(subject.id); // none of a known one
    known.value = world.known.includes(subject.id) ? String(subject.id) : "";
    if (known.value) entity.selectedIndex = -1;
    for (const part of ["own", "own-direction"]) at(part, HTMLElement).hidden = !isOwn;
    if (isOwn) [facts, given] = [subject.facts, state.given];
    if (isOwn && document.activeElement !== name) name.value = subject.name;
    columns.forEach(({ by, dial, again, label, place }, number) => {
      const { name: chosen, dial: value } = choices[number], range = dialOf(world, chosen), random = RANDOM.includes(chosen);
      by.value = chosen;
      again.hidden = !random;
      place.hidden = random || !range;
      if (!range) return;
      dial.min = String(range.least);
      dial.max = String(range.most);
      dial.value = String(value);
      label.textContent = `${range.label} of ${chosen.toUpperCase()} = ${value}`;
    });
    at("about", HTMLElement).textContent = about(world, state);
    showFacts(world, state, change, remove);
  };
}

/** @param {World} world @param {State} state */
function about(world, { subject }) {
  const kind = world.kinds[subject.kind], known = world.names.indexOf(subject.name.toLowerCase());
  if (subject.id >= 0) {
    return world.novel.includes(subject.id) ? `${subject.name} (${kind}): this Θ⁰ has never seen it.`
      : `${subject.name} (${kind}): its vector is left out here, but its neighbours' vectors were trained with it.`;
  }
  if (world.novel.includes(known)) return `${subject.name} is in the list of new entities, with facts that are observed: choose it there.`;
  if (known >= 0) return `${subject.name} is known already: this inserts a second one. To leave the known one out, choose it under “More”.`;
  const { id: near, sure } = nearestByName(world, subject.name);
  if (near < 0) return `No known phrase shares a word with it: it has no word vector here. Its kind is a guess: ${kind}.`;
  return sure ? `Its words are taken from the nearest known phrase, “${world.names[near]}”; its kind, too: ${kind}.`
    : `A guess: no known phrase ends in its last word. Its words are taken from “${world.names[near]}”; its kind: ${kind}.`;
}

/** The facts that may be given, as boxes; they stay in place while they are ticked; a reader's own may be removed.
 * @param {World} world @param {State} state @param {(change: Partial<State>) => void} change
 * @param {(place: number) => void} remove */
function showFacts(world, { subject, given }, change, remove) {
  const box = at("facts", HTMLElement), key = JSON.stringify([subject.id, subject.name, subject.facts]);
  if (box.dataset.of !== key) {
    box.dataset.of = key;
    box.replaceChildren(...subject.offered.map((place) => {
      const fact = subject.facts[place], tick = html("input", { type: "checkbox", value: place });
      tick.addEventListener("change", () => {
        const ticked = [...box.querySelectorAll("input")].filter((one) => one.checked).map((one) => Number(one.value));
        change({ given: ticked });
      });
      const words = asked(world, fact, subject.name, world.names[fact.other]), label = html("label", {}, tick, asked(world, fact, fact.isTail ? "…" : "", world.names[fact.other]).trim());
      if (subject.id >= 0) return label;
      const button = html("button", { type: "button", class: "ex-remove", "aria-label": `Remove: ${words}` }, "×");
      button.addEventListener("click", () => remove(place));
      return html("span", {}, label, button);
    }));
  }
  for (const tick of box.querySelectorAll("input")) tick.checked = given.includes(Number(tick.value));
  const tests = subject.facts.length - subject.offered.length;
  at("facts-box", HTMLElement).hidden = !subject.offered.length;
  at("held", HTMLElement).textContent = tests ? `${tests} more ${tests === 1 ? "is" : "are"} never offered: the test set.` : "";
}
