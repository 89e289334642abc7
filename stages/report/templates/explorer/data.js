/* The data of the page: Θ⁰ of one seed, its graph, and what is known of an entity that is inserted into it. */

/** A triple of the graph; ``split``: 0 training, 1 validation, 2 test, -1 not of this seed.
 * @typedef {{head: number, relation: number, tail: number, count: number, split: number}} Triple */
/** A triple of an inserted entity, seen from it; ``triple``: its id, -1 for a reader's own.
 * @typedef {{triple: number, relation: number, isTail: boolean, other: number, count: number, split: number}} Fact */
/** Vectors of entities by id, and the maps of relations.
 * @typedef {{entity: Float64Array[], map: Float64Array[]}} Embedding */
/** JSON of the page; arrays of numbers are base64.
 * @typedef {{
 *   size: number, seed: number, model: string, scalars: number, dimension: number, names: string[], kinds: string[],
 *   kind: number[], relations: string[], known: number[], novel: number[], start: number, theta0: string, map: string,
 *   cosines: string, worded: number[], triples: number[][], given: Object<string, number[]>,
 *   random: Object<string, string>, joint: string, jointScale: number, jointMap: string, jointPlaces: number[][],
 *   fitted: number, projection: string, share: number,
 *   initializers: {name: string, label: string, options: Object<string, number>}[],
 * }} Payload */
/** @typedef {ReturnType<typeof decode>} World */

/** @param {string} text base64 of little-endian numbers @param {typeof Float32Array | typeof Int16Array} kind */
function numbers(text, kind) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  return Float64Array.from(new kind(bytes.buffer));
}

/** @param {Float64Array} values @param {number} width */
function rows(values, width) {
  return Array.from({ length: values.length / width }, (_, row) => values.slice(row * width, (row + 1) * width));
}

/** @param {Payload} payload */
export function decode(payload) {
  const { names, dimension } = payload, entity = names.map(() => new Float64Array(dimension));
  rows(numbers(payload.theta0, Float32Array), dimension).forEach((v, place) => { entity[payload.known[place]] = v; });
  const cosines = names.map(() => new Float64Array(names.length)), upper = numbers(payload.cosines, Float32Array);
  let place = 0;
  names.forEach((_, row) => {
    for (let column = row; column < names.length; column++) {
      cosines[row][column] = cosines[column][row] = upper[place++];
    }
  });
  const worded = names.map(() => false);
  for (const id of payload.worded) worded[id] = true;
  const joint = numbers(payload.joint, Int16Array).map((value) => value * payload.jointScale);
  const [centre, axis] = rows(numbers(payload.projection, Float32Array), dimension);
  const random = new Map(Object.entries(payload.random).map(([id, text]) => [Number(id), numbers(text, Float32Array)]));
  return {
    ...payload, cosines, worded, centre, axis, random,
    triples: payload.triples.map(([head, relation, tail, count, split]) => ({ head, relation, tail, count, split })),
    theta0: { entity, map: rows(numbers(payload.map, Float32Array), dimension) },
    joint: { entity: rows(joint, dimension), map: rows(numbers(payload.jointMap, Float32Array), dimension) },
  };
}

/** What is known before an insertion: D⁰ without the entity that is inserted.
 * @typedef {{known: number[], eligible: boolean[], triples: Triple[]}} Before */
/** An entity to insert; ``id``: -1 for a reader's own; ``cosines``: of its words with those of each entity, or null;
 * ``offered``: places in ``facts`` of what may be given; the others are the test facts.
 * @typedef {{id: number, name: string, kind: number, cosines: Float64Array | null, facts: Fact[], offered: number[],
 *   before: Before}} Subject */

/** @type {WeakMap<World, Map<number, Before>>} */
const GROUNDS = new WeakMap();

/** D⁰ without the entity ``id`` (-1: all of it), computed once. @param {World} world @param {number} id
 * @returns {Before} */
export function beforeOf(world, id) {
  const made = GROUNDS.get(world) ?? new Map(), key = world.known.includes(id) ? id : -1;
  GROUNDS.set(world, made);
  if (!made.has(key)) {
    const known = world.known.filter((one) => one !== key), there = new Set(known);
    const triples = world.triples.filter(({ head, tail, split }) => split >= 0 && there.has(head) && there.has(tail));
    const eligible = world.names.map(() => false);
    for (const { head, tail, split } of triples) if (split === 0) eligible[head] = eligible[tail] = true;
    made.set(key, { known, eligible, triples });
  }
  return made.get(key);
}

/** The known entities that known triples have at the end that is asked for. @param {Before} before
 * @param {{relation: number, isTail: boolean}} query ``isTail``: the new entity is the tail */
export function candidates({ known, triples }, query) {
  const there = new Set(triples.flatMap(({ head, relation, tail }) => (relation === query.relation ? [query.isTail ? head : tail] : [])));
  return known.filter((id) => there.has(id));
}

/** An entity of the graph. @param {World} world @param {number} id @returns {Subject} */
export function subjectOf(world, id) {
  const before = beforeOf(world, id), there = new Set(before.known);
  const facts = world.triples.flatMap(({ head, relation, tail, count, split }, triple) => {
    const isTail = tail === id, other = isTail ? head : tail;
    const own = split >= 0 && (isTail || head === id) && there.has(other);
    return own ? [{ triple, relation, isTail, other, count, split }] : [];
  });
  const given = world.given[id] ?? [];
  return {
    id, name: world.names[id], kind: world.kind[id], cosines: world.worded[id] ? world.cosines[id] : null, facts,
    offered: facts.flatMap(({ triple }, place) => (given.includes(triple) ? [place] : [])), before,
  };
}

/** Words of a name: lower-case, apart at hyphens, in the singular. @param {string} name */
const wordsOf = (name) => name.toLowerCase().split(/[\s_-]+/).filter(Boolean).map(singular);

/** The singular of a regular English plural, else the word. @param {string} word */
function singular(word) {
  if (word.length < 4 || /(ss|us|is)$/.test(word)) return word;
  if (/(shel|kni|lea|hal)ves$/.test(word)) return word.replace(/ves$/, word.includes("kni") ? "fe" : "f");
  if (/[^aeiou]ies$/.test(word)) return `${word.slice(0, -3)}y`;
  if (/(ch|sh|ss|x|to)es$/.test(word)) return word.slice(0, -2);
  return word.replace(/s$/, "");
}

/** The entity with the nearest name, or -1: names with the same last word first, since it says what a thing is, then those
 * that share most letters of whole words, then shorter ones; ``sure``: whether the last words are the same.
 * @param {World} world @param {string} name */
export function nearestByName(world, name) {
  const words = wordsOf(name), last = words.at(-1);
  const near = world.names.flatMap((known, id) => {
    const theirs = world.worded[id] ? wordsOf(known) : [], shared = theirs.filter((word) => words.includes(word)).join("").length;
    return shared ? [{ id, sure: theirs.at(-1) === last, shared, long: known.length }] : [];
  });
  near.sort((a, b) => Number(b.sure) - Number(a.sure) || b.shared - a.shared || a.long - b.long);
  return near[0] ?? { id: -1, sure: false };
}

/** A reader's own entity: words of the entity with the nearest name, if there is one, and its kind; if that name is a
 * guess, the most common kind.
 * @param {World} world @param {string} name @param {Fact[]} facts @returns {Subject} */
export function ownSubject(world, name, facts) {
  const { id: near, sure } = nearestByName(world, name), number = world.kinds.map((_, kind) => world.kind.filter((k) => k === kind).length);
  return {
    id: -1, name, kind: !sure ? number.indexOf(Math.max(...number)) : world.kind[near],
    cosines: near < 0 ? null : world.cosines[near], facts, offered: facts.map((_, place) => place),
    before: beforeOf(world, -1),
  };
}
