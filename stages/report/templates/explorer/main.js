/* The explorer: what is chosen is computed here, in the browser, and stands in the address. */
import { drawAnswers, summaryOf } from "./answers_view.js";
import { makeControls } from "./controls.js";
import { decode, subjectOf } from "./data.js";
import { at } from "./elements.js";
import { insertion } from "./insertion.js";
import { makeMap } from "./map_view.js";
import { address, choiceOf, parse } from "./state.js";

/** @import { Insertion } from "./insertion.js" */
/** @import { Choice, State } from "./state.js" */

const world = decode(JSON.parse(at("data", HTMLElement).textContent ?? ""));
const box = at("box", HTMLElement), start = subjectOf(world, world.start);
const choices = ["ers", "mean"].map((name) =>
  choiceOf(world, world.initializers.some((one) => one.name === name) ? name : world.initializers[0].name));
/** @type {State} */
let state = { subject: start, given: start.offered, choices };
/** @type {Map<string, Insertion>} */
const made = new Map();

/** An insertion, computed once for a subject. @param {Choice} choice */
function shown(choice) {
  const { subject, given } = state, key = JSON.stringify([subject.id, subject.name, subject.facts, given, choice]);
  const found = made.get(key) ?? insertion(world, subject, given, choice);
  if (made.size > 50) made.clear();
  made.set(key, found);
  return found;
}

function draw() {
  const both = state.choices.map(shown);
  show(state, both);
  map.draw(state, both);
  drawAnswers(world, state, both, map.point);
}

/** @param {Partial<State>} changed */
function change(changed) {
  const before = state;
  state = { ...state, ...changed };
  history.replaceState(null, "", address(world, state));
  draw();
  announce(before);
}

let waiting = 0;

/** Says what changed, and MRR*, once a control rests. @param {State} before */
function announce(before) {
  clearTimeout(waiting);
  waiting = setTimeout(() => {
    at("changed", HTMLElement).textContent = summaryOf(world, state, state.choices.map(shown), before);
  }, 300);
}

const map = makeMap(world), show = makeControls(world, change, () => state);

function recall() {
  const found = parse(world, location.hash, state);
  if (!found) return;
  state = found;
  draw();
  for (let part = box.parentElement; part; part = part.parentElement) if (part instanceof HTMLDetailsElement) part.open = true;
  if (location.hash.includes("/")) box.scrollIntoView();
}

box.hidden = false;
draw();
recall();
addEventListener("hashchange", recall);
/* For the console, and for tests. */
Object.assign(window, { explorer: { world, subjectOf, insertion, parse, address, state: () => state, change } });
