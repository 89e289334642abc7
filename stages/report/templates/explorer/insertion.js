/* One insertion, computed: vector, answers, MRR*. */
import { candidates } from "./data.js";
import { dot, length } from "./linear_algebra.js";
import { insert } from "./initializers.js";
import { mrrStar, ranked, scores } from "./ranking.js";
import { relationalScore } from "./similarity.js";

/** @import { Subject, World } from "./data.js" */
/** @import { Choice } from "./state.js" */
/** @typedef {{relation: number, isTail: boolean, true: Map<number, number>}} Query ``true``: fact of each true answer */
/** @typedef {ReturnType<typeof insertion>} Insertion */

/** An initializer's insertion, or (``choice`` null) the joint model. @param {World} world @param {Subject} subject
 * @param {number[]} given @param {Choice | null} choice */
export function insertion(world, subject, given, choice) {
  const result = choice ? insert(world, subject, given, choice.name, choice.dial)
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
    ...result, scoreOf, mrrStar: mrrStar(world, subject, scoreOf), indicators: indicatorsOf(subject, result.weights),
    place: choice ? placeOf(world, result.vector) : world.jointPlaces[subject.id],
    /** Candidates and true answers, best first. @param {Query} query */
    answers: (query) => ranked(scoreOf(query.relation, query.isTail),
      [...new Set([...candidates(subject.before, query), ...query.true.keys()])]),
  };
}

/** Ids of the entities whose mean it is; none if these are all.
 * @param {Subject} subject @param {Float64Array | null} weights */
function indicatorsOf({ before }, weights) {
  const listed = Array.from(weights ?? []).flatMap((weight, id) => (weight ? [id] : []));
  return listed.length === before.known.length ? [] : listed;
}

/** The queries of an entity: those with true answers, then those that half of its kind have, most frequent first.
 * @param {World} world @param {Subject} subject @returns {Query[]} */
export function queriesOf(world, subject) {
  const queries = world.relations.flatMap((_, relation) => [false, true].map((isTail) => ({
    relation, isTail,
    true: new Map(subject.facts.flatMap((fact, place) =>
      (fact.relation === relation && fact.isTail === isTail ? [[fact.other, place]] : []))),
  })));
  /** @param {number[]} ids */
  const ofKind = (ids) => ids.filter((id) => world.kind[id] === subject.kind).length;
  const others = queries.filter((query) => !query.true.size)
    .map((query) => ({ query, number: ofKind(candidates(subject.before, { ...query, isTail: !query.isTail })) }));
  const half = Math.max(ofKind(subject.before.known) / 2, 1);
  const frequent = others.filter(({ number }) => number >= half).sort((a, b) => b.number - a.number);
  return [...queries.filter((query) => query.true.size), ...frequent.map(({ query }) => query)];
}

/** Rank of each known entity by relations, best 1, or null without facts. @param {World} world
 * @param {Subject} subject @param {number[]} given */
export function relationalRanks(world, subject, given) {
  if (!given.length) return null;
  const score = relationalScore(world, given.map((place) => subject.facts[place]));
  return new Map(ranked(score, subject.before.known).map((id, place) => [id, place + 1]));
}

/** Place of a vector on the map: its distance from the centre, and where it is along the axis. @param {World} world
 * @param {Float64Array} v */
export function placeOf({ centre, axis }, v) {
  const apart = v.map((value, i) => value - centre[i]);
  return [length(apart), dot(apart, axis)];
}
