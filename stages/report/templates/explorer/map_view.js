/* The map: known entities, both vectors with lines from their indicators, and the joint model's vector, each at its
   distance from the centre and its place along the first principal axis. */
import { at, fill, fixed, svg } from "./elements.js";
import { placeOf } from "./insertion.js";

/** @import { World } from "./data.js" */
/** @import { Insertion } from "./insertion.js" */
/** @import { State } from "./state.js" */

const [WIDTH, HEIGHT, EDGE] = [640, 460, 16], REACH = 30, FONT = 12;

/** @param {World} world */
export function makeMap(world) {
  const drawing = document.getElementById("explorer-map"), name = at("map-name", HTMLElement);
  if (!(drawing instanceof SVGSVGElement)) throw new Error("no map");
  const layer = Object.fromEntries(["axes", "lines", "dots", "vectors", "labels"].map((part) => [part, svg("g", { class: `ex-${part}` })]));
  const known = world.names.map((_, id) => svg("circle", { class: "ex-dot", "data-entity": id, r: 3 }));
  const joint = svg("path", { class: "ex-joint", d: "M0 -8l6.5 8l-6.5 8l-6.5 -8z" });
  const vectors = [svg("circle", { class: "ex-vector ex-first", r: 8 }), svg("rect", { class: "ex-vector ex-second", x: -7, y: -7, width: 14, height: 14 })];
  const ring = svg("circle", { class: "ex-ring", r: 9, visibility: "hidden" });
  const raw = world.theta0.entity.map((v) => placeOf(world, v));
  const usual = world.known.reduce((sum, id) => sum + raw[id][0], 0) / world.known.length;
  let places = /** @type {number[][]} */ ([]), listed = /** @type {number[]} */ ([]), active = -1;
  layer.dots.append(...known, ring);
  layer.vectors.append(joint, ...vectors);
  drawing.append(...Object.values(layer));

  /** @param {number} id */
  function point(id) {
    active = id;
    ring.setAttribute("visibility", id < 0 ? "hidden" : "visible");
    name.textContent = id < 0 ? "" : `${world.names[id]} (${world.kinds[world.kind[id]]})`;
    if (id >= 0) fill(ring, { cx: places[id][0], cy: places[id][1] }, []);
    for (const node of document.querySelectorAll("#explorer-box [data-entity]")) {
      node.classList.toggle("ex-lit", node.getAttribute("data-entity") === String(id));
    }
  }

  /** @param {PointerEvent} event */
  function nearest(event) {
    const { x, y } = new DOMPoint(event.clientX, event.clientY).matrixTransform(drawing?.getScreenCTM()?.inverse());
    const away = listed.map((id) => Math.hypot(places[id][0] - x, places[id][1] - y)), least = Math.min(...away);
    point(least < REACH ? listed[away.indexOf(least)] : -1);
  }
  drawing.addEventListener("pointermove", nearest);
  drawing.addEventListener("pointerdown", nearest);
  drawing.addEventListener("pointerleave", (event) => { if (event.pointerType === "mouse") point(-1); });
  drawing.addEventListener("blur", () => point(-1));
  drawing.addEventListener("keydown", (event) => {
    const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
    if (step === undefined) return;
    event.preventDefault();
    const order = listed.slice().sort((a, b) => places[a][0] - places[b][0]);
    const place = active < 0 ? (step > 0 ? 0 : -1) : order.indexOf(active) + step;
    point(order.at(place % order.length) ?? -1);
  });

  /** @param {State} state @param {Insertion[]} shown */
  function draw({ subject }, shown) {
    const size = FONT * Math.max(1, 1 / (drawing?.getScreenCTM()?.a || 1)); // of text: 12 px on the screen
    const ends = [...shown.map(({ place }) => place), ...(subject.id < 0 ? [] : [world.jointPlaces[subject.id]])];
    const all = [...world.known.map((id) => raw[id]), ...ends], bottom = HEIGHT - 2.6 * size;
    const [far, low, high] = [Math.max(...all.map(([x]) => x)), ...[Math.min, Math.max].map((end) => end(...all.map(([, y]) => y)))];
    const left = 8 + 0.62 * size * Math.max(...ticks(low, high).map((value) => shortest(value).length)); // room for numbers
    /** @param {number[]} place */
    const onto = ([x, y]) => [left + (x / far) * (WIDTH - left - EDGE), bottom - EDGE - ((y - low) / (high - low)) * (bottom - 2 * EDGE)]
      .map((value) => Math.round(10 * value) / 10);
    places = raw.map(onto);
    listed = subject.before.known;
    const there = new Set(listed);
    known.forEach((dot, id) => fill(dot, { cx: places[id][0], cy: places[id][1], visibility: there.has(id) ? "visible" : "hidden" }, []));
    const marks = ends.map(onto);
    [...vectors, joint].forEach((mark, number) => {
      mark.setAttribute("visibility", marks[number] ? "visible" : "hidden");
      if (marks[number]) mark.style.transform = `translate(${marks[number].map((value) => `${value}px`).join()})`;
    });
    drawAxes(far, low, high, onto, size, bottom, left);
    layer.lines.replaceChildren(...shown.flatMap(({ indicators }, number) => indicators.map((id) => svg("path", {
      class: number ? "ex-second" : "ex-first", d: `M${places[id].join(" ")}L${marks[number].join(" ")}` }))));
    drawNames([...new Set(shown.flatMap(({ indicators }) => indicators))], size, bottom);
    if (active >= 0) point(there.has(active) ? active : -1);
  }

  /** @param {number} far @param {number} low @param {number} high @param {(place: number[]) => number[]} onto @param {number} size
   * @param {number} bottom @param {number} left */
  function drawAxes(far, low, high, onto, size, bottom, left) {
    /** @param {number} x @param {number} y @param {string} anchor @param {string} text */
    const text = (x, y, anchor, text) => svg("text", { x, y, "text-anchor": anchor, "font-size": size }, text), [average] = onto([usual, 0]);
    layer.axes.replaceChildren(
      svg("path", { d: `M${left} ${EDGE}V${bottom}H${WIDTH - EDGE}` }), svg("path", { class: "ex-usual", d: `M${average} ${EDGE}V${bottom}` }),
      ...ticks(0, far).map((value) => text(onto([value, 0])[0], bottom + size * 1.1, "middle", shortest(value))),
      ...ticks(low, high).map((value) => text(left - 5, onto([0, value])[1] + size / 3, "end", shortest(value))),
      text(WIDTH - EDGE, bottom + size * 2.2, "end", "distance from the centre →"), text(2, size, "start", "↑ first principal axis"),
      text(average + 4, bottom - 5, "start", `known vectors: ${fixed(usual, 1)} on average`));
  }

  /** Names of indicators in a column right of them, each with a line to its point, as many as fit. @param {number[]} ids
   * @param {number} size @param {number} bottom */
  function drawNames(ids, size, bottom) {
    const line = 1.15 * size, shown = ids.slice(0, Math.floor(bottom / line) - 2).sort((a, b) => places[a][1] - places[b][1]);
    const longest = Math.max(...shown.map((id) => world.names[id].length)), edge = Math.max(...shown.map((id) => places[id][0]));
    const left = Math.min(edge + 3 * size, WIDTH - 0.56 * size * longest);
    const heights = shown.map((id) => places[id][1]);
    heights.forEach((height, row) => { heights[row] = Math.max(height, line + size, row ? heights[row - 1] + line : 0); });
    for (let row = heights.length - 1; row >= 0; row--) heights[row] = Math.min(heights[row], bottom - line * (heights.length - row));
    layer.labels.replaceChildren(...shown.flatMap((id, row) => [
      svg("path", { class: "ex-leader", d: `M${places[id].join(" ")}L${left - 4} ${heights[row]}` }),
      svg("text", { x: left, y: heights[row] + size / 3, "font-size": size }, world.names[id])]));
  }
  return { draw, point };
}

/** Four to eight round numbers between two. @param {number} low @param {number} high */
function ticks(low, high) {
  const power = 10 ** Math.floor(Math.log10((high - low) / 3 || 1)), step = power * ([5, 2].find((one) => one * power * 3 <= high - low) ?? 1);
  return Array.from({ length: Math.floor(high / step) - Math.ceil(low / step) + 1 }, (_, place) => (Math.ceil(low / step) + place) * step);
}

/** @param {number} value */
const shortest = (value) => String(Number(value.toPrecision(3))).replace("-", "−");
