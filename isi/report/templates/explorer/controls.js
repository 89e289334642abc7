/* Controls: the entity, its facts as boxes to tick, and two initializers, each with its dial. */
import { asked } from "./answers_view.js";
import { nearestByName, ownSubject, subjectOf } from "./data.js";
import { at, html } from "./elements.js";
import { choiceOf, dialOf, factOf } from "./state.js";

/** @import { Fact, World } from "./data.js" */
/** @import { Insertion } from "./insertion.js" */
/** @import { State } from "./state.js" */

const OF_READER = "own"; // value of the option

/** @param {World} world @param {(change: Partial<State>) => void} change @param {() => State} current */
export function makeControls(world, change, current) {
  const entity = at("entity", HTMLSelectElement), name = at("own-name", HTMLInputElement);
  const [relation, side, other] = ["relation", "side", "other"].map((id) => at(`own-${id}`, HTMLSelectElement));
  /** @param {number[]} ids */
  const byName = (ids) => ids.slice().sort((a, b) => world.names[a].localeCompare(world.names[b]))
    .map((id) => html("option", { value: id }, world.names[id]));
  entity.append(html("optgroup", { label: "New to this Θ⁰" }, ...byName(world.novel)),
    html("option", { value: OF_READER }, "a name of your own …"),
    html("optgroup", { label: "Θ⁰ was trained with it" }, ...byName(world.known)));
  other.append(...byName(world.known));
  relation.append(...world.relations.map((text, id) => html("option", { value: id }, text)));
  side.append(html("option", { value: 0 }, "new entity →"), html("option", { value: 1 }, "→ new entity"));

  let facts = /** @type {Fact[]} */ ([]), given = /** @type {number[]} */ ([]); // of the reader's own entity
  const insertOwn = () => change({ subject: ownSubject(world, name.value.trim() || "something", facts), given });
  entity.addEventListener("change", () => {
    if (entity.value === OF_READER) return insertOwn();
    const subject = subjectOf(world, Number(entity.value));
    change({ subject, given: subject.given });
  });
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
    const by = at(`by-${number}`, HTMLSelectElement), dial = at(`dial-${number}`, HTMLInputElement);
    by.append(...world.initializers.map((one) => html("option", { value: one.name }, one.label)));
    /** @param {State["choices"][number]} choice */
    const choose = (choice) => change({ choices: current().choices.map((old, place) => (place === number ? choice : old)) });
    by.addEventListener("change", () => choose(choiceOf(world, by.value)));
    dial.addEventListener("input", () => choose({ name: by.value, dial: Number(dial.value) }));
    return { by, dial, label: at(`dial-label-${number}`, HTMLLabelElement), place: at(`dial-box-${number}`, HTMLElement) };
  });
  const usual = at("usual", HTMLButtonElement), all = at("all", HTMLButtonElement), none = at("none", HTMLButtonElement);
  usual.addEventListener("click", () => change({ given: current().subject.given }));
  all.addEventListener("click", () => change({ given: current().subject.facts.flatMap((fact, place) => (fact.split ? [] : [place])) }));
  none.addEventListener("click", () => change({ given: [] }));

  /** @param {State} state @param {Insertion[]} shown */
  return function show(state, shown) {
    const { subject, choices } = state, isOwn = subject.id < 0;
    entity.value = isOwn ? OF_READER : String(subject.id);
    at("own", HTMLElement).hidden = !isOwn;
    if (isOwn) [facts, given] = [subject.facts, state.given];
    if (isOwn && document.activeElement !== name) name.value = subject.name;
    columns.forEach(({ by, dial, label, place }, number) => {
      const range = dialOf(world, choices[number].name);
      by.value = choices[number].name;
      place.style.visibility = range ? "" : "hidden"; // its room stays: nothing else moves
      if (!range) return;
      dial.min = String(range.least);
      dial.max = String(range.most);
      dial.value = String(shown[number].dial);
      label.textContent = `${range.label} = ${shown[number].dial}`;
    });
    at("about", HTMLElement).textContent = about(world, state);
    showFacts(world, state, change, remove);
  };
}

/** @param {World} world @param {State} state */
function about(world, { subject }) {
  const kind = world.kinds[subject.kind];
  if (subject.id < 0) {
    const { id: near, sure } = nearestByName(world, subject.name);
    if (near < 0) return `No known phrase shares a word with it: it has no word vector here. Its kind is a guess: ${kind}.`;
    return sure ? `Its words are taken from the nearest known phrase, “${world.names[near]}”; its kind, too: ${kind}.`
      : `A guess: no known phrase ends in its last word. Its words are taken from “${world.names[near]}”; its kind: ${kind}.`;
  }
  return world.novel.includes(subject.id) ? `${subject.name} (${kind}): this Θ⁰ has never seen it.`
    : `${subject.name} (${kind}): its vector is left out here, but its neighbours' vectors were trained with it.`;
}

/** The facts that may be given, as boxes; they stay in place while they are ticked; a reader's own may be removed.
 * @param {World} world @param {State} state @param {(change: Partial<State>) => void} change
 * @param {(place: number) => void} remove */
function showFacts(world, { subject, given }, change, remove) {
  const box = at("facts", HTMLElement), key = JSON.stringify([subject.id, subject.name, subject.facts]);
  if (box.dataset.of !== key) {
    box.dataset.of = key;
    box.replaceChildren(...subject.facts.flatMap((fact, place) => {
      if (fact.split) return [];
      const tick = html("input", { type: "checkbox", value: place });
      tick.addEventListener("change", () => {
        const ticked = [...box.querySelectorAll("input")].filter((one) => one.checked).map((one) => Number(one.value));
        change({ given: ticked });
      });
      const words = asked(world, fact, subject.name, world.names[fact.other]), label = html("label", {}, tick, asked(world, fact, fact.isTail ? "…" : "", world.names[fact.other]).trim());
      if (subject.id >= 0) return [label];
      const button = html("button", { type: "button", class: "ex-remove", "aria-label": `Remove: ${words}` }, "×");
      button.addEventListener("click", () => remove(place));
      return [html("span", {}, label, button)];
    }));
  }
  for (const tick of box.querySelectorAll("input")) tick.checked = given.includes(Number(tick.value));
  const held = subject.facts.filter(({ split }) => split).length;
  at("facts-box", HTMLElement).hidden = !subject.facts.length;
  at("usual", HTMLElement).hidden = subject.id < 0;
  at("held", HTMLElement).textContent = held ? `${held} more ${held === 1 ? "is" : "are"} held out and only asked for.` : "";
}
