/* What is shown, as it stands in the address: #explorer/NAME/FIRST/SECOND/GIVEN/FACTS. */
import { ownSubject, subjectOf } from "./data.js";
import { RANDOM } from "./initializers.js";

/** @import { Fact, Subject, World } from "./data.js" */
/** An initializer and its dial: k, or the number of a draw. @typedef {{name: string, dial: number}} Choice */
/** @typedef {{subject: Subject, given: number[], choices: Choice[]}} State */

const OWN = "+"; // before the name of a reader's own entity
const DRAWS = 999;

/** @param {World} world @param {string} name @returns {{label: string, least: number, most: number, usual: number} | null} */
export function dialOf(world, name) {
  const options = world.initializers.find((one) => one.name === name)?.options ?? {};
  if (RANDOM.includes(name)) return { label: "draw", least: 1, most: DRAWS, usual: 1 };
  return "k" in options ? { label: "k", least: 1, most: options.candidates ?? 30, usual: options.k } : null;
}

/** @param {World} world @param {string} name @returns {Choice} */
export const choiceOf = (world, name) => ({ name, dial: dialOf(world, name)?.usual ?? 0 });

/** @param {World} world @param {State} state */
export function address(world, { subject, given, choices }) {
  const usual = given.join() === subject.offered.join(), own = subject.id < 0;
  return ["#explorer", (own ? OWN : "") + encodeURIComponent(subject.name),
    ...choices.map(({ name, dial }) => (dial === choiceOf(world, name).dial ? name : `${name}~${dial}`)),
    ...(usual && !own ? [] : [given.join(".")]),
    ...(own ? [subject.facts.map(({ relation, isTail, other }) => [relation, Number(isTail), other].join(".")).join(",")] : []),
  ].join("/");
}

/** What an address says; whatever it lacks, or says wrong, is as in ``state``. @param {World} world
 * @param {string} text @param {State} state @returns {State | null} null if it leads elsewhere */
export function parse(world, text, state) {
  const [section, name, first, second, given, facts] = text.split("/");
  if (section !== "#explorer") return null;
  const subject = subjectNamed(world, name ?? "", facts ?? "") ?? state.subject;
  const places = given === undefined ? subject.offered : given.split(".").filter(Boolean).map(Number);
  const mayBeGiven = places.every((place) => subject.offered.includes(place));
  const choices = [first, second].map((part, number) => {
    const [by = "", dial] = (part ?? "").split("~"), range = dialOf(world, by);
    if (!world.initializers.some((one) => one.name === by)) return state.choices[number];
    const wanted = Math.round(Number(dial ?? 0));
    if (!range || !wanted) return choiceOf(world, by);
    return { name: by, dial: Math.min(Math.max(wanted, range.least), range.most) };
  });
  return { subject, given: mayBeGiven ? places : subject.offered, choices };
}

/** @param {World} world @param {string} text @param {string} facts @returns {Subject | null} */
function subjectNamed(world, text, facts) {
  if (text.startsWith(OWN)) {
    const own = facts.split(",").filter(Boolean).map((fact) => fact.split(".").map(Number))
      .filter(([relation, , other]) => world.relations[relation] && world.known.includes(other));
    return ownSubject(world, decoded(text.slice(1)), own.map(([relation, isTail, other]) => factOf(relation, isTail === 1, other)));
  }
  const id = world.names.indexOf(decoded(text));
  return world.known.includes(id) || world.novel.includes(id) ? subjectOf(world, id) : null;
}

/** A reader's own fact. @param {number} relation @param {boolean} isTail @param {number} other @returns {Fact} */
export const factOf = (relation, isTail, other) => ({ triple: -1, relation, isTail, other, count: 1, split: 0 });

/** @param {string} text */
function decoded(text) {
  try {
    return decodeURIComponent(text);
  } catch {
    return text;
  }
}
