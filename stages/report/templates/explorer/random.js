/* Random numbers of the page: they follow from the initializer, the entity's name and the number of the draw alone. */

/** ``size`` numbers in [0, 1). @param {string} initializer @param {string} entity @param {number} draw
 * @param {number} size */
export function uniform(initializer, entity, draw, size) {
  let state = hash(`${initializer} ${draw} ${entity}`);
  return new Float64Array(size).map(() => { // mulberry32
    state = (state + 0x6d2b79f5) | 0;
    let mixed = Math.imul(state ^ (state >>> 15), state | 1);
    mixed ^= mixed + Math.imul(mixed ^ (mixed >>> 7), mixed | 61);
    return ((mixed ^ (mixed >>> 14)) >>> 0) / 2 ** 32;
  });
}

/** 32 bits of a text: FNV-1a of its bytes in UTF-8. @param {string} text */
function hash(text) {
  let bits = 0x811c9dc5;
  for (const byte of new TextEncoder().encode(text)) bits = Math.imul(bits ^ byte, 0x01000193);
  return bits;
}
