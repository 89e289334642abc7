/* Relations as linear maps W of scalars and 2×2 blocks [[x, y], [-y, x]] (ANALOGY, DistMult, ComplEx). A vector has its
   scalars first, then the first coordinates of all blocks, then the second ones; f(h, r, t) = hᵀWt. */

/** @param {Float64Array} v @param {Float64Array} map r, x and y of each scalar and block @param {number} scalars
 * @param {number} sign of y @param {boolean} inverted */
function apply(v, map, scalars, sign, inverted) {
  const CLAMP = 1e-6, half = (v.length - scalars) / 2, result = new Float64Array(v.length);
  for (let i = 0; i < scalars; i++) {
    const r = map[i];
    result[i] = v[i] * (inverted ? (r < 0 ? -1 : 1) / Math.max(Math.abs(r), CLAMP) : r);
  }
  for (let i = scalars; i < scalars + half; i++) {
    const norm = inverted ? Math.max(map[i] ** 2 + map[i + half] ** 2, CLAMP) : 1;
    const x = map[i] / norm, y = (sign * map[i + half]) / norm;
    result[i] = v[i] * x - v[i + half] * y;
    result[i + half] = v[i + half] * x + v[i] * y;
  }
  return result;
}

/** vᵀW: where tails of head v are expected. @param {Float64Array} v @param {Float64Array} map @param {number} scalars */
export const transform = (v, map, scalars) => apply(v, map, scalars, 1, false);

/** Wv. @param {Float64Array} v @param {Float64Array} map @param {number} scalars */
export const transformTail = (v, map, scalars) => apply(v, map, scalars, -1, false);

/** vᵀW⁻¹: where heads of tail v are expected. @param {Float64Array} v @param {Float64Array} map
 * @param {number} scalars */
export const invert = (v, map, scalars) => apply(v, map, scalars, -1, true);
