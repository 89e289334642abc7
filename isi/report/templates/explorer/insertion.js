/* One insertion, computed: vector, answers, rank of each true answer, MRR*. */
import { insert, RANDOM } from "./initializers.js";
import { mrrStar, ranked, scores } from "./ranking.js";
import { DRAWS } from "./random.js";
import { relationalScore } from "./similarity.js";
import { length } from "./linear_algebra.js";

/** @import { Subject, World } from "./data.js" */
/** @import { Choice } from "./state.js" */
/** @typedef {{relation: number, isTail: boolean, true: Map<number, number>}} Query ``true``: fact of each true answer */
/** @typedef {ReturnType<typeof insertion>} Insertion */

/** An initializer's insertion, or (``choice`` null) the joint model. @param {World} world @param {Subject} subject
 * @param {number[]} given @param {Choice | null} choice */
export function insertion(world, subject, given, choice) {
  const dial = choice && (choice.dial || !RANDOM.includes(choice.name) ? choice.dial : medianDraw(world, subject, choice.name));
  const result = choice ? insert(world, subject, given, choice.name, dial ?? 0)
    : { vector: world.joint.entity[subject.id], weights: null, fallback: null };
  /** @type {Map<string, Float64Array>} */
  const made = new Map();
  /** @param {number} relation @param {boolean} isTail */
  const scoreOf = (relation, isTail) => {
    const key = `${relation} ${isTail}`, embedding = choice ? world.theta0 : world.joint;
    if (!made.has(key)) made.set(key, scores(world, embedding, result.vector, subject.id, relation, isTail));
    return /** @type {Float64Array} */ (made.get(key));
  };
  return {
    ...result, dial, scoreOf, length: length(result.vector), mrrStar: mrrStar(world, subject, given, scoreOf),
    indicators: indicatorsOf(result.weights),
    /** @param {Query} query */
    answers: ({ relation, isTail }) => ranked(scoreOf(relation, isTail), subject.before.known),
  };
}

/** Insertions by each draw of a random initializer, computed once for a subject: they do not depend on its facts.
 * @type {WeakMap<Subject, Map<string, Insertion[]>>} */
const DRAWN = new WeakMap();

/** MRR* of each draw of a random initializer, by the facts that are given; without those that have none.
 * @param {World} world @param {Subject} subject @param {number[]} given @param {string} name */
export function mrrStarsOfDraws(world, subject, given, name) {
  const byName = DRAWN.get(subject) ?? new Map();
  DRAWN.set(subject, byName);
  if (!byName.has(name)) {
    byName.set(name, Array.from({ length: DRAWS }, (_, place) => insertion(world, subject, given, { name, dial: place + 1 })));
  }
  const drawn = /** @type {Insertion[]} */ (byName.get(name));
  return drawn.flatMap(({ scoreOf }) => mrrStar(world, subject, given, scoreOf) ?? []);
}

/** The draw with the median MRR* (of an even number the lower one), from the facts that are given at first.
 * @param {World} world @param {Subject} subject @param {string} name */
function medianDraw(world, subject, name) {
  const values = mrrStarsOfDraws(world, subject, subject.given, name);
  const order = values.map((_, place) => place).sort((a, b) => values[a] - values[b] || a - b);
  return values.length ? order[Math.ceil(order.length / 2) - 1] + 1 : 1;
}

/** Ids of entities by weight, largest first, without those below half a per cent. @param {Float64Array | null} weights */
function indicatorsOf(weights) {
  const listed = Array.from(weights ?? [], (weight, id) => ({ id, weight })).filter(({ weight }) => weight > 0.005);
  return listed.sort((a, b) => b.weight - a.weight || a.id - b.id);
}

/** The queries of an entity: those with true answers, then those that others of its kind have, most frequent first. @param {World} world
 * @param {Subject} subject @returns {Query[]} */
export function queriesOf(world, subject) {
  const queries = world.relations.flatMap((_, relation) => [false, true].map((isTail) => ({
    relation, isTail,
    true: new Map(subject.facts.flatMap((fact, place) =>
      (fact.relation === relation && fact.isTail === isTail ? [[fact.other, place]] : []))),
  })));
  /** @param {Query} query */
  const ofKind = ({ relation, isTail }) => subject.before.triples.filter((triple) => triple.relation === relation
    && world.kind[isTail ? triple.tail : triple.head] === subject.kind).length;
  const others = queries.filter((query) => !query.true.size).map((query) => ({ query, number: ofKind(query) }));
  const frequent = others.filter(({ number }) => number).sort((a, b) => b.number - a.number);
  return [...queries.filter((query) => query.true.size), ...frequent.map(({ query }) => query)];
}

/** Rank of each known entity by relations, best 1, or null without facts. @param {World} world
 * @param {Subject} subject @param {number[]} given */
export function relationalRanks(world, subject, given) {
  if (!given.length) return null;
  const { score } = relationalScore(world, given.map((place) => subject.facts[place]));
  return new Map(ranked(score, subject.before.known).map((id, place) => [id, place + 1]));
}

/** Place of a vector on the map. @param {World} world @param {Float64Array} v */
export const placeOf = (world, v) => world.axes.map((axis) =>
  axis.reduce((sum, value, i) => sum + value * (v[i] - world.centre[i]), 0));

