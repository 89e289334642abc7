/* The initializers: the first vector of an entity, from its facts, its words and Θ⁰. */
import { uniform } from "./random.js";
import { meanOfAll, meanOfFirst, relationalScore, topK } from "./similarity.js";

/** @import { Fact, Subject, World } from "./data.js" */
/** @import { Result } from "./similarity.js" */
/** ``dial``: k of ES, RS and ERS; number of the draw of Xavier and IU; the first one of Xavier is that of the run, if there is one.
 * @typedef {(world: World, subject: Subject, facts: Fact[], options: Object<string, number>, dial: number) => Result
 * } Initializer */

/** Those that draw: their dial is the number of the draw. */
export const RANDOM = ["xavier", "iu"];

/** @type {Object<string, Initializer>} */
const INITIALIZERS = {
  mean: (world, subject) => meanOfAll(world, subject, null),
  xavier: (world, subject, facts, options, draw) => {
    const bound = 6 / Math.sqrt(world.dimension), first = world.random.get(subject.id);
    return random(draw === 1 && first ? first : uniform("xavier", subject.name, draw, world.dimension).map((value) => value * 2 * bound - bound));
  },
  iu: (world, subject, facts, options, draw) => {
    const { low, high } = ranges(world, subject);
    return random(uniform("iu", subject.name, draw, world.dimension)
      .map((value, axis) => value * (high[axis] - low[axis]) + low[axis]));
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
        return topK(relationalScore(world, facts), similar, k);
      },
    },
    { needs: "facts", weigh: () => related(world, subject, facts, k) },
    { needs: "words", weigh: () => topK(cosines(subject), named(world, subject), k) },
  ]),
};

/** @param {Float64Array} vector @returns {Result} */
const random = (vector) => ({ vector, weights: null, fallback: null });

/** Ranges of coordinates of known vectors, computed once for what is known. @type {WeakMap<Subject["before"], Ranges>} */
const RANGES = new WeakMap();

/** @typedef {{low: number[], high: number[]}} Ranges @param {World} world @param {Subject} subject @returns {Ranges} */
function ranges(world, { before }) {
  const there = RANGES.get(before);
  if (there) return there;
  const axes = Array.from({ length: world.dimension }, (_, axis) => before.known.map((id) => world.theta0.entity[id][axis]));
  const made = { low: axes.map((values) => Math.min(...values)), high: axes.map((values) => Math.max(...values)) };
  RANGES.set(before, made);
  return made;
}

/** @param {Subject} subject */
const cosines = (subject) => subject.cosines ?? new Float64Array();

/** @param {World} world @param {Subject} subject */
const named = (world, subject) => subject.before.eligible.map((may, id) => may && world.worded[id]);

/** @param {World} world @param {Subject} subject @param {Fact[]} facts @param {number} k */
const related = (world, subject, facts, k) => topK(relationalScore(world, facts), subject.before.eligible, k);

/** @param {World} world @param {Subject} subject @param {number[]} given places in the subject's facts
 * @param {string} name @param {number} dial */
export function insert(world, subject, given, name, dial) {
  const options = world.initializers.find((one) => one.name === name)?.options ?? {};
  return INITIALIZERS[name](world, subject, given.map((place) => subject.facts[place]), options, dial);
}
