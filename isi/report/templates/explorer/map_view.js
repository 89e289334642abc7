/* The map: known entities, both vectors with lines from their indicators, and the joint model's vector. */
import { at, fill, svg } from "./elements.js";
import { placeOf } from "./insertion.js";

/** @import { World } from "./data.js" */
/** @import { Insertion } from "./insertion.js" */
/** @import { State } from "./state.js" */

const [WIDTH, HEIGHT, MARGIN] = [640, 420, 24], REACH = 30, MOST_LINES = 40;

/** @param {World} world */
export function makeMap(world) {
  const drawing = document.getElementById("explorer-map"), name = at("map-name", HTMLElement);
  if (!(drawing instanceof SVGSVGElement)) throw new Error("no map");
  const layer = Object.fromEntries(["lines", "dots", "vectors", "labels"].map((part) => [part, svg("g", { class: `ex-${part}` })]));
  const known = world.names.map((_, id) => svg("circle", { class: "ex-dot", "data-entity": id, r: 3 }));
  const joint = svg("path", { class: "ex-joint", d: "M0 -8l6.5 8l-6.5 8l-6.5 -8z" });
  const vectors = [svg("circle", { class: "ex-vector ex-first", r: 8 }), svg("rect", { class: "ex-vector ex-second", x: -7, y: -7, width: 14, height: 14 })];
  const ring = svg("circle", { class: "ex-ring", r: 9, visibility: "hidden" });
  /** @type {Map<string, SVGPathElement>} */
  const lines = new Map();
  let places = /** @type {number[][]} */ ([]), listed = /** @type {number[]} */ ([]), active = -1;
  layer.dots.append(...known, ring);
  layer.vectors.append(joint, ...vectors);
  drawing.append(layer.lines, layer.dots, layer.vectors, layer.labels);

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
    const frame = drawing?.getBoundingClientRect() ?? new DOMRect();
    const scale = WIDTH / frame.width, x = (event.clientX - frame.left) * scale, y = (event.clientY - frame.top) * scale;
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
    const jointPlace = subject.id < 0 ? [] : [world.jointPlaces[subject.id]];
    const at = [...shown.map(({ vector }) => placeOf(world, vector)), ...jointPlace];
    const raw = world.theta0.entity.map((v) => placeOf(world, v)), known_ = subject.before.known;
    const onto = fitted([...known_.map((id) => raw[id]), ...at]);
    places = raw.map(onto);
    listed = known_;
    known.forEach((dot, id) => {
      fill(dot, { cx: places[id][0], cy: places[id][1], visibility: known_.includes(id) ? "visible" : "hidden" }, []);
    });
    const ends = at.map(onto);
    [...vectors, joint].forEach((mark, number) => {
      mark.setAttribute("visibility", ends[number] ? "visible" : "hidden");
      if (ends[number]) mark.style.transform = `translate(${ends[number][0]}px, ${ends[number][1]}px)`;
    });
    drawLines(shown, ends);
    drawLabels(subject.name, shown, ends);
    if (active >= 0) point(active);
  }

  /** @param {Insertion[]} shown @param {number[][]} ends */
  function drawLines(shown, ends) {
    const kept = new Set();
    shown.forEach(({ indicators }, number) => {
      if (indicators.length > MOST_LINES) return;
      for (const { id, weight } of indicators) {
        const key = `${number} ${id}`, d = `M${places[id].join(" ")}L${ends[number].join(" ")}`;
        const line = lines.get(key) ?? svg("path", { class: number ? "ex-second" : "ex-first" });
        line.style.opacity = String(Math.min(1, 0.25 + weight * 2));
        line.setAttribute("d", d);
        if (!lines.has(key)) layer.lines.append(line);
        lines.set(key, line);
        kept.add(key);
      }
    });
    for (const [key, line] of lines) {
      if (!kept.has(key)) { line.remove(); lines.delete(key); }
    }
  }

  /** Names of the entity and of indicators, where nothing else is written. @param {string} text
   * @param {Insertion[]} shown @param {number[][]} ends */
  function drawLabels(text, shown, ends) {
    const zoom = (drawing?.clientWidth ?? WIDTH) < 480 ? 1.6 : 1, taken = /** @type {number[][]} */ ([]);
    /** @param {string} words @param {number[]} place @param {number} apart @param {string} style */
    const write = (words, [x, y], apart, style) => {
      const width = 6.4 * zoom * words.length, line = 12 * zoom;
      const spots = [[apart, line / 3], [-apart - width, line / 3], [-width / 2, -apart], [-width / 2, apart + line]];
      const free = spots.map(([right, down]) => [x + right, y + down]).find(([left, base]) => left > 0 && left + width < WIDTH
        && base > line && base < HEIGHT && taken.every(([start, row, long]) =>
        left > start + long || start > left + width || Math.abs(base - row) > line));
      if (!free) return [];
      taken.push([...free, width]);
      return [svg("text", { x: free[0], y: free[1], class: style }, words)];
    };
    const ids = new Set(shown.flatMap(({ indicators }) => (indicators.length > MOST_LINES ? [] : indicators.map(({ id }) => id))));
    layer.labels.replaceChildren(
      ...write(text, ends[0], 11, "ex-own"), ...[...ids].slice(0, 24).flatMap((id) => write(world.names[id], places[id], 6, "")),
    );
  }
  return { draw, point };
}

/** From places on the map to the drawing, as large as it can be. @param {number[][]} places */
function fitted(places) {
  const [low, high] = [Math.min, Math.max].map((end) => [0, 1].map((axis) => end(...places.map((place) => place[axis]))));
  const room = [WIDTH - 2 * MARGIN, HEIGHT - 2 * MARGIN];
  const scale = Math.min(...room.map((size, axis) => size / (high[axis] - low[axis] || 1)));
  /** @param {number[]} place */
  return ([x, y]) => [WIDTH / 2 + scale * (x - (low[0] + high[0]) / 2), HEIGHT / 2 - scale * (y - (low[1] + high[1]) / 2)]
    .map((value) => Math.round(10 * value) / 10);
}
