/* Vectors are Float64Arrays. */

/** @param {Float64Array} a @param {Float64Array} b */
export function dot(a, b) {
  let sum = 0;
  for (let i = 0; i < a.length; i++) sum += a[i] * b[i];
  return sum;
}

/** @param {Float64Array} v */
export const length = (v) => Math.sqrt(dot(v, v));

/** A vector of length 1, or zeros. @param {Float64Array} v */
export function unit(v) {
  const by = Math.max(length(v), 1e-12);
  return v.map((value) => value / by);
}

/** sum += factor * v. @param {Float64Array} sum @param {Float64Array} v */
export function add(sum, v, factor = 1) {
  for (let i = 0; i < sum.length; i++) sum[i] += factor * v[i];
}
