/* Elements of the page; text of the data becomes text nodes alone. */

/** @typedef {Object<string, string | number>} Attributes */

const SVG = "http://www.w3.org/2000/svg";

/** @template {Element} T @param {T} node @param {Attributes} attributes @param {(Node | string)[]} children */
export function fill(node, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, String(value));
  node.append(...children);
  return node;
}

/** @template {keyof HTMLElementTagNameMap} K @param {K} tag @param {Attributes} attributes
 * @param {(Node | string)[]} children */
export const html = (tag, attributes = {}, ...children) => fill(document.createElement(tag), attributes, children);

/** @template {keyof SVGElementTagNameMap} K @param {K} tag @param {Attributes} attributes
 * @param {(Node | string)[]} children */
export const svg = (tag, attributes = {}, ...children) => fill(document.createElementNS(SVG, tag), attributes, children);

/** An element of the explorer. @template {HTMLElement} T @param {string} id @param {new () => T} kind */
export function at(id, kind) {
  const found = document.getElementById(`explorer-${id}`);
  if (!(found instanceof kind)) throw new Error(`no element explorer-${id}`);
  return found;
}

/** @param {number} value @param {number} digits */
export const fixed = (value, digits) => value.toFixed(digits).replace(/^-/, "−");
