/* The initializers: the first vector of an entity, from its facts, its words and Θ⁰. */
import { mostProbable } from "./newton.js";
import { allKnown, meanOfFirst, relationalScore, softmax, topK } from "./similarity.js";

/** @import { Fact, Subject, World } from "./data.js" */
/** @import { Result } from "./similarity.js" */
/** ``dial``: k of ES, RS and ERS; number of the draw of Xavier and IU.
 * @typedef {(world: World, subject: Subject, facts: Fact[], options: Object<string, number>, dial: number) => Result
 * } Initializer */

/** @type {Object<string, Initializer>} */
const INITIALIZERS = {
  xavier: (world, subject, facts, options, draw) => {
    const bound = 6 / Math.sqrt(world.dimension);
    return random(uniform(world, "xavier", draw).map((value) => value * 2 * bound - bound));
  },
  iu: (world, subject, facts, options, draw) => {
    const vectors = subject.before.known.map((id) => world.theta0.entity[id]);
    return random(uniform(world, "iu", draw).map((value, axis) => {
      const of = vectors.map((v) => v[axis]), low = Math.min(...of);
      return value * (Math.max(...of) - low) + low;
    }));
  },
  es: (world, subject, facts, options, k) => meanOfFirst(world, subject, facts, [
    { needs: "words", weigh: () => topK(cosines(subject), named(world, subject), k) },
    { needs: "facts", weigh: () => related(world, subject, facts, k) },
  ]),
  rs: (world, subject, facts, options, k) => meanOfFirst(world, subject, facts, [
    { needs: "facts", weigh: () => related(world, subject, facts, k) },
  ]),
  ers: (world, subject, facts, { candidates }, k) => meanOfFirst(world, subject, facts, [
    {
      needs: "both",
      weigh: () => {
        const similar = Array.from(topK(cosines(subject), named(world, subject), candidates), Boolean);
        return topK(relationalScore(world, facts).score, similar, k);
      },
    },
    { needs: "facts", weigh: () => related(world, subject, facts, k) },
    { needs: "words", weigh: () => topK(cosines(subject), named(world, subject), k) },
  ]),
  mean: (world, subject, facts) => meanOfFirst(world, subject, facts, [
    { needs: "nothing", weigh: () => allKnown(world, subject) },
  ]),
  kind_mean: (world, subject, facts) => meanOfFirst(world, subject, facts, [
    {
      needs: "nothing",
      weigh: () => allKnown(world, subject).map((known, id) => known * Number(world.kind[id] === subject.kind)),
    },
  ]),
  soft_hybrid: (world, subject, facts, { word_weight: byWords, relation_weight: byRelations }) => {
    const { score, relations } = relationalScore(world, facts), { eligible } = subject.before;
    const near = score.map((value) => (byRelations * value) / relations);
    const similar = subject.cosines?.map((value) => byWords * value) ?? score;
    return meanOfFirst(world, subject, facts, [
      { needs: "both", weigh: () => softmax(near.map((value, id) => value + similar[id]), named(world, subject)) },
      { needs: "facts", weigh: () => softmax(near, eligible) },
      { needs: "words", weigh: () => softmax(similar, named(world, subject)) },
    ]);
  },
  map: (world, subject, facts, options) => {
    const prior = INITIALIZERS.soft_hybrid(world, subject, facts, options, 0);
    const vector = mostProbable(world, subject, facts, prior.vector, options);
    return { vector, weights: prior.weights, fallback: facts.length ? null : prior.fallback };
  },
};

/** @param {Float64Array} vector @returns {Result} */
const random = (vector) => ({ vector, weights: null, fallback: null });

/** Numbers in [0, 1): the first draw is that of the runs, the others are the page's. @param {World} world
 * @param {string} name @param {number} draw */
function uniform(world, name, draw) {
  if (draw <= 1) return world.uniform[name];
  let state = Math.imul(draw, 0x9e3779b1) ^ Math.imul(name.length, 0x85ebca6b);
  return world.uniform[name].map(() => { // mulberry32
    state = (state + 0x6d2b79f5) | 0;
    let mixed = Math.imul(state ^ (state >>> 15), state | 1);
    mixed ^= mixed + Math.imul(mixed ^ (mixed >>> 7), mixed | 61);
    return ((mixed ^ (mixed >>> 14)) >>> 0) / 2 ** 32;
  });
}

/** @param {Subject} subject */
const cosines = (subject) => subject.cosines ?? new Float64Array();

/** @param {World} world @param {Subject} subject */
const named = (world, subject) => subject.before.eligible.map((may, id) => may && world.worded[id]);

/** @param {World} world @param {Subject} subject @param {Fact[]} facts @param {number} k */
const related = (world, subject, facts, k) => topK(relationalScore(world, facts).score, subject.before.eligible, k);

/** @param {World} world @param {Subject} subject @param {number[]} given places in the subject's facts
 * @param {string} name @param {number} dial */
export function insert(world, subject, given, name, dial) {
  const options = world.initializers.find((one) => one.name === name)?.options ?? {};
  return INITIALIZERS[name](world, subject, given.map((place) => subject.facts[place]), options, dial);
}
