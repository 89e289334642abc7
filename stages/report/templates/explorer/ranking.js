/* Answers to (entity, relation, ?) and (?, relation, entity), and MRR* over the test facts. */
import { dot } from "./linear_algebra.js";
import { transform, transformTail } from "./model.js";

/** @import { Embedding, Subject, World } from "./data.js" */

const TIE = 1e-5; // of the largest score: closer ones are tied

/** Scores of each entity as the other end of the entity with this vector; ``id``: its row, which has the vector now.
 * @param {World} world @param {Embedding} embedding @param {Float64Array} vector @param {number} id
 * @param {number} relation @param {boolean} isTail */
export function scores(world, embedding, vector, id, relation, isTail) {
  const mapped = (isTail ? transformTail : transform)(vector, embedding.map[relation], world.scalars);
  const result = new Float64Array(embedding.entity.length);
  embedding.entity.forEach((v, row) => { result[row] = dot(mapped, row === id ? vector : v); });
  return result;
}

/** The known entities, best first; ties: lower id. @param {Float64Array} score @param {number[]} known */
export const ranked = (score, known) => known.slice().sort((a, b) => score[b] - score[a] || a - b);

/** MRR* over the test facts, with the entity given and the other end hidden; null if there are none.
 * @param {World} world @param {Subject} subject @param {(relation: number, isTail: boolean) => Float64Array} scoreOf
 * @returns {number | null} */
export function mrrStar(world, subject, scoreOf) {
  /** @type {Map<number, number[]>} */
  const byRelation = new Map();
  subject.facts.forEach((fact, place) => {
    if (subject.offered.includes(place)) return;
    const { relation, isTail, other, count } = fact, score = scoreOf(relation, isTail);
    const tie = TIE * score.reduce((most, value) => Math.max(most, Math.abs(value)), 0);
    let trueRank = 1, rank = 1;
    const left = new Set([other]);
    subject.facts.forEach((one, at) => {
      if (one.relation !== relation || one.isTail !== isTail || one.other === other) return;
      if (subject.offered.includes(at) || one.count === count) left.add(one.other);
      else if (one.count > count) trueRank += 1;
    });
    for (const id of subject.before.known) {
      const ahead = score[id] - score[other];
      if (!left.has(id)) rank += (Number(ahead > tie) + Number(ahead >= -tie)) / 2;
    }
    byRelation.set(relation, [...(byRelation.get(relation) ?? []), 1 / (Math.abs(trueRank - rank) + 1)]);
  });
  const observed = world.relations.map(() => 0), { triples } = world, own = subject.id;
  const loops = triples.filter(({ head, tail, split }) => head === own && tail === own && split >= 0);
  for (const { relation, count } of [...subject.before.triples, ...subject.facts, ...loops]) observed[relation] += count;
  let sum = 0, total = 0;
  for (const [relation, terms] of byRelation) {
    sum += (observed[relation] * terms.reduce((a, b) => a + b, 0)) / terms.length;
    total += observed[relation];
  }
  return total ? sum / total : null;
}
