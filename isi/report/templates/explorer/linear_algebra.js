/* Vectors are Float64Arrays; a square matrix is one Float64Array, row by row. */

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

/** @param {Float64Array} matrix @param {Float64Array} v */
export function times(matrix, v) {
  const size = v.length;
  return v.map((_, row) => dot(matrix.subarray(row * size, (row + 1) * size), v));
}

/** The Cholesky factor L of a symmetric positive definite matrix LLᵀ, whose lower half alone is read.
 * @param {Float64Array} matrix @param {number} size */
export function cholesky(matrix, size) {
  const factor = new Float64Array(size * size);
  for (let row = 0; row < size; row++) {
    for (let column = 0; column <= row; column++) {
      let rest = matrix[row * size + column];
      for (let i = 0; i < column; i++) rest -= factor[row * size + i] * factor[column * size + i];
      factor[row * size + column] = row === column ? Math.sqrt(rest) : rest / factor[column * size + column];
    }
  }
  return factor;
}

/** x of LLᵀx = right. @param {Float64Array} factor @param {Float64Array} right */
export function solve(factor, right) {
  const size = right.length, x = right.slice();
  for (let row = 0; row < size; row++) {
    for (let i = 0; i < row; i++) x[row] -= factor[row * size + i] * x[i];
    x[row] /= factor[row * size + row];
  }
  for (let row = size - 1; row >= 0; row--) {
    for (let i = row + 1; i < size; i++) x[row] -= factor[i * size + row] * x[i];
    x[row] /= factor[row * size + row];
  }
  return x;
}

/** @param {Float64Array} matrix symmetric, positive definite @param {number} size */
export function inverse(matrix, size) {
  const factor = cholesky(matrix, size), result = new Float64Array(size * size), axis = new Float64Array(size);
  for (let column = 0; column < size; column++) {
    axis.fill(0)[column] = 1;
    result.set(solve(factor, axis), column * size); // symmetric: a column is a row
  }
  return result;
}
