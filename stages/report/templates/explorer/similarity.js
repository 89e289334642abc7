/* Similarity by words and by relations, and means of similar entities: the parts of ISI. */
import { add, dot, unit } from "./linear_algebra.js";
import { invert, transform } from "./model.js";

/** @import { Fact, Subject, World } from "./data.js" */
/** A vector; weights of the entities whose mean it is; what was used for lack of data.
 * @typedef {{vector: Float64Array, weights: Float64Array | null, fallback: string | null}} Result */
/** Weights of entities, by the data that they need.
 * @typedef {{needs: "words" | "facts" | "both", weigh: () => Float64Array}} Way */

/** The vectors of Θ⁰ with length 1, computed once. @type {WeakMap<World, Float64Array[]>} */
const DIRECTIONS = new WeakMap();

/** @param {World} world */
function directions(world) {
  const made = DIRECTIONS.get(world) ?? world.theta0.entity.map(unit);
  DIRECTIONS.set(world, made);
  return made;
}

/** Σ_r cos(v_e, ᾱ_r) over the relations of facts; ᾱ_r: mean of where they expect the entity.
 * @param {World} world @param {Fact[]} facts */
export function relationalScore(world, facts) {
  const { entity, map } = world.theta0, means = new Map();
  for (const { relation, isTail, other } of facts) {
    const expected = (isTail ? transform : invert)(entity[other], map[relation], world.scalars);
    if (means.has(relation)) add(means.get(relation), expected);
    else means.set(relation, expected);
  }
  const units = [...means.values()].map(unit);
  const score = new Float64Array(entity.length);
  directions(world).forEach((v, id) => { for (const mean of units) score[id] += dot(mean, v); });
  return score;
}

/** 1 for the k of highest score among ``eligible``, ties to the lower id, else 0.
 * @param {Float64Array} score @param {boolean[]} eligible @param {number} k */
export function topK(score, eligible, k) {
  const weights = new Float64Array(score.length);
  const ids = eligible.flatMap((may, id) => (may ? [id] : [])).sort((a, b) => score[b] - score[a] || a - b);
  for (const id of ids.slice(0, k)) weights[id] = 1;
  return weights;
}

/** The mean by the first of ``ways`` that has its data, else of all known. @param {World} world
 * @param {Subject} subject @param {Fact[]} facts @param {Way[]} ways @returns {Result} */
export function meanOfFirst(world, subject, facts, ways) {
  const has = { words: subject.cosines !== null, facts: facts.length > 0, both: false };
  has.both = has.words && has.facts;
  for (const [place, { needs, weigh }] of ways.entries()) {
    const weights = has[needs] ? weigh() : new Float64Array();
    const fallback = place === 0 ? null : needs === "words" ? "words alone" : "facts alone";
    if (weights.some((weight) => weight !== 0)) return meanOf(world, weights, fallback);
  }
  return meanOfAll(world, subject, "the centre of all known entities");
}

/** @param {World} world @param {Subject} subject @param {string | null} fallback @returns {Result} */
export function meanOfAll(world, subject, fallback) {
  const weights = new Float64Array(world.names.length);
  for (const id of subject.before.known) weights[id] = 1;
  return meanOf(world, weights, fallback);
}

/** @param {World} world @param {Float64Array} weights @param {string | null} fallback @returns {Result} */
function meanOf(world, weights, fallback) {
  const vector = new Float64Array(world.dimension), total = weights.reduce((sum, weight) => sum + weight, 0);
  const shares = weights.map((weight) => weight / total);
  shares.forEach((share, id) => { if (share) add(vector, world.theta0.entity[id], share); });
  return { vector, weights: shares, fallback };
}
