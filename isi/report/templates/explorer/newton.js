/* MAP: the vector that best fits weighted triples and a normal prior around a mean, by Newton's method. */
import { add, cholesky, dot, inverse, solve, times } from "./linear_algebra.js";
import { transform, transformTail } from "./model.js";

/** @import { Before, Fact, Subject, World } from "./data.js" */
/** Triples of the vector v with scores ⟨v, α⟩: α, and numbers of true and of false ones.
 * @typedef {{alpha: Float64Array, positive: number, negative: number}[]} Evidence */

const SHRINKAGE = 0.1, STEPS = 20, TOLERANCE = 1e-6, ROUNDING = 1e-6, HALVINGS = 10, CLOSE = 3e-3;
const NEGLIGIBLE = 1e-3; // of the largest curvature: rows below it stay out of the Hessian

/** α of a triple with each entity as the known end, by (relation, whether v is the tail, entity), computed once.
 * @type {WeakMap<World, Map<number, Float64Array>>} */
const ANCHORS = new WeakMap();
/** Σ⁻¹ of the known vectors, and how many triples each (relation, end, entity) is in, computed once.
 * @type {WeakMap<Before, {precision: Float64Array, number: Map<number, number>}>} */
const PREPARED = new WeakMap();

/** @param {World} world @param {number} relation @param {boolean} isTail @param {number} other */
const keyOf = (world, relation, isTail, other) => (2 * relation + Number(isTail)) * world.names.length + other;

/** @param {World} world @param {number} key */
function anchor(world, key) {
  const made = ANCHORS.get(world) ?? new Map(), slot = Math.floor(key / world.names.length);
  ANCHORS.set(world, made);
  if (!made.has(key)) {
    const map = world.theta0.map[Math.floor(slot / 2)], other = world.theta0.entity[key % world.names.length];
    made.set(key, (slot % 2 ? transform : transformTail)(other, map, world.scalars));
  }
  return made.get(key);
}

/** The covariance of the known vectors, shrunk towards an isotropic one, inverted. @param {World} world
 * @param {number[]} known */
function precisionOf(world, known) {
  const size = world.dimension, centre = new Float64Array(size), full = new Float64Array(size * size);
  for (const id of known) add(centre, world.theta0.entity[id], 1 / known.length);
  for (const id of known) {
    const apart = world.theta0.entity[id].map((value, axis) => value - centre[axis]);
    apart.forEach((value, row) => add(full.subarray(row * size, (row + 1) * size), apart, value / known.length));
  }
  const mean = centre.reduce((sum, _, axis) => sum + full[axis * size + axis], 0) / size;
  return inverse(full.map((value, at) => (1 - SHRINKAGE) * value + (at % (size + 1) ? 0 : SHRINKAGE * mean)), size);
}

/** @param {World} world @param {Before} before */
function preparedOf(world, before) {
  let prepared = PREPARED.get(before);
  if (!prepared) {
    const number = new Map();
    for (const { head, relation, tail } of before.trained) {
      for (const key of [keyOf(world, relation, false, tail), keyOf(world, relation, true, head)]) {
        number.set(key, (number.get(key) ?? 0) + 1);
      }
    }
    prepared = { precision: precisionOf(world, before.known), number };
    PREPARED.set(before, prepared);
  }
  return prepared;
}

/** The facts; what they would be with another end or relation; known triples with the entity as a wrong end.
 * @param {World} world @param {Before} before @param {Fact[]} facts @param {Object<string, number>} options
 * @returns {Evidence} */
function evidenceOf(world, before, facts, { ratio, known_negatives: share }) {
  const positive = new Map(), negative = new Map(), known = before.known, others = world.relations.length - 1;
  /** @param {Map<number, number>} weights @param {number} key @param {number} weight */
  const count = (weights, key, weight) => weights.set(key, (weights.get(key) ?? 0) + weight);
  const ends = new Map();
  for (const { relation, isTail, other } of facts) {
    count(positive, keyOf(world, relation, isTail, other), 1);
    count(ends, keyOf(world, relation, isTail, 0), ratio / known.length);
    world.relations.forEach((_, wrong) => {
      if (wrong !== relation) count(negative, keyOf(world, wrong, isTail, other), ratio / others);
    });
  }
  for (const [slot, weight] of ends) for (const id of known) count(negative, slot + id, weight);
  const complete = Math.min(1, facts.length / ((2 * before.trained.length) / known.length) || 0);
  for (const [key, number] of preparedOf(world, before).number) {
    count(negative, key, (complete * share * ratio * number) / known.length);
  }
  return [...new Set([...positive.keys(), ...negative.keys()])].map((key) => ({
    alpha: anchor(world, key), positive: positive.get(key) ?? 0, negative: negative.get(key) ?? 0,
  }));
}

/** The most probable vector: that of least Σ w⁺ softplus(-f) + Σ w⁻ softplus(f) + λ/2 (v - μ)ᵀΣ⁻¹(v - μ).
 * @param {World} world @param {Subject} subject @param {Fact[]} facts @param {Float64Array} mean μ
 * @param {Object<string, number>} options */
export function mostProbable(world, subject, facts, mean, options) {
  const evidence = evidenceOf(world, subject.before, facts, options);
  const precision = preparedOf(world, subject.before).precision.map((value) => value * options.strength);
  /** @param {Float64Array} at */
  const scoresOf = (at) => evidence.map(({ alpha }) => dot(alpha, at));
  /** @param {Float64Array} at @param {number[]} scores */
  const objective = (at, scores) => {
    const apart = at.map((value, axis) => value - mean[axis]);
    return scores.reduce((sum, score, row) => sum + evidence[row].positive * softplus(-score)
      + evidence[row].negative * softplus(score), dot(apart, times(precision, apart)) / 2);
  };
  let at = mean, scores = scoresOf(at);
  for (let number = 0; number < STEPS; number++) {
    const { step, gain } = stepOf(evidence, scores, precision, at.map((value, axis) => value - mean[axis]));
    const here = objective(at, scores);
    let share = 1, there = at, lower = 0;
    for (let tried = 0; tried < HALVINGS; tried++) {
      there = at.map((value, axis) => value + share * step[axis]);
      scores = scoresOf(there);
      const after = objective(there, scores);
      lower = here - after;
      if (after <= here * (1 + ROUNDING)) break;
      share /= 2;
    }
    at = there;
    if (gain <= TOLERANCE || (share < 1 && lower < CLOSE)) break;
  }
  return at;
}

/** Newton's step, and twice the gain that it promises. @param {Evidence} evidence @param {number[]} scores
 * @param {Float64Array} precision @param {Float64Array} apart v - μ */
function stepOf(evidence, scores, precision, apart) {
  const size = apart.length, gradient = times(precision, apart), hessian = precision.slice();
  const rows = evidence.map(({ alpha, positive, negative }, place) => {
    const likely = 1 / (1 + Math.exp(-scores[place])), weight = positive + negative;
    add(gradient, alpha, weight * likely - positive);
    return { alpha, curvature: weight * likely * (1 - likely) };
  });
  const least = NEGLIGIBLE * Math.max(...rows.map(({ curvature }) => curvature));
  const curved = rows.filter(({ curvature }) => curvature >= least); // the gradient is exact: so is the optimum
  for (let place = 0; place < curved.length; place += 4) { // four at a time, which is twice as fast
    const [a, b, c, d] = [0, 1, 2, 3].map((more) => curved[Math.min(place + more, curved.length - 1)].alpha);
    const [p, q, r, s] = [0, 1, 2, 3].map((more) => curved[place + more]?.curvature ?? 0);
    for (let row = 0; row < size; row++) {
      const start = row * size, ofA = p * a[row], ofB = q * b[row], ofC = r * c[row], ofD = s * d[row];
      for (let column = 0; column <= row; column++) {
        hessian[start + column] += ofA * a[column] + ofB * b[column] + ofC * c[column] + ofD * d[column];
      }
    }
  }
  const step = solve(cholesky(hessian, size), gradient).map((value) => -value);
  return { step, gain: -dot(gradient, step) };
}

/** @param {number} x */
const softplus = (x) => Math.max(x, 0) + Math.log1p(Math.exp(-Math.abs(x)));
