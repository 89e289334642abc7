/* The map: known entities, both vectors with lines from their indicators, and the joint model's vector. */
import { at, fill, svg } from "./elements.js";
import { placeOf } from "./insertion.js";

/** @import { World } from "./data.js" */
/** @import { Insertion } from "./insertion.js" */
/** @import { State } from "./state.js" */

const [WIDTH, HEIGHT, MARGIN] = [640, 460, 56], REACH = 30, MOST_LINES = 40;

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
    const jointPlace = subject.id < 0 ? [] : [world.jointPlaces[subject.id]], raw = world.theta0.entity.map((v) => placeOf(world, v));
    const at = [...shown.map(({ vector }) => placeOf(world, vector)), ...jointPlace], means = shown.flatMap(lined);
    const onto = means.length ? fitted([...means.map((id) => raw[id]), ...shown.flatMap((one, number) => (one.weights ? [at[number]] : [])), ...jointPlace])
      : fitted([...subject.before.known.map((id) => raw[id]), ...at]);
    places = raw.map(onto);
    listed = subject.before.known.filter((id) => places[id].join() === inside(places[id]).join());
    const visible = new Set(listed);
    known.forEach((dot, id) => {
      fill(dot, { cx: places[id][0], cy: places[id][1], visibility: visible.has(id) ? "visible" : "hidden" }, []);
    });
    const ends = at.map((place) => inside(onto(place)));
    [...vectors, joint].forEach((mark, number) => {
      mark.setAttribute("visibility", ends[number] ? "visible" : "hidden");
      if (ends[number]) mark.style.transform = `translate(${ends[number][0]}px, ${ends[number][1]}px)`;
    });
    drawLines(shown, ends);
    drawLabels(shown, ends);
    if (active >= 0) point(visible.has(active) ? active : -1);
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

  /** Names of indicators, beside their points, else where there is room, with a line to the point.
   * @param {Insertion[]} shown @param {number[][]} ends */
  function drawLabels(shown, ends) {
    const zoom = Math.max(1, 1.08 / (drawing?.getScreenCTM()?.a || 1)), line = 12.5 * zoom;
    const taken = ends.map(([x, y]) => ({ left: x - 9, right: x + 9, top: y - 9, bottom: y + 9 }));
    const ids = [...new Set(shown.flatMap(lined))];
    for (const id of ids) taken.push(around(places[id], 4, 4));
    layer.labels.replaceChildren(...ids.sort((a, b) => places[a][1] - places[b][1]).flatMap((id) => {
      const [x, y] = places[id], half = 3.1 * zoom * world.names[id].length;
      const away = x < ends[0][0] ? -1 : 1; // from the vector: its lines are on the other side
      for (const [right, down] of SPOTS.map(([far, low]) => [away * far, low])) {
        const centre = [x + right * line + Math.sign(right) * (half + 6), y + down * line], box = around(centre, half, line / 2);
        if (box.left < 0 || box.right > WIDTH || box.top < 0 || box.bottom > HEIGHT || taken.some((one) => overlap(one, box))) continue;
        taken.push(box);
        const text = svg("text", { x: centre[0], y: centre[1] + line * 0.3, "text-anchor": "middle", "font-size": 11 * zoom }, world.names[id]);
        const nearby = Math.hypot(right, down) < 1.1, to = [Math.min(Math.max(x, box.left), box.right), Math.min(Math.max(y, box.top + 3), box.bottom - 3)];
        return nearby ? [text] : [svg("path", { class: "ex-leader", d: `M${x} ${y}L${to.join(" ")}` }), text];
      }
      return [];
    }));
  }
  return { draw, point };
}

/** How far a spot is; one towards the vector counts as a line farther. @param {number[]} spot */
const farness = ([right, down]) => Math.hypot(right, down) + Number(right < 0) * 1.1;

/** Where a name may stand, in lines of text from its point, first right of it, away from the vector: nearest first. */
const SPOTS = [0, 1, 2, 3, 4, 5, 6, 8, 10, 13, 16, 20].flatMap((far) => (far ? [-1, -0.5, 0, 0.5, 1].flatMap((down) => [[far, far * down], [-far, far * down]])
  .concat([[0, far], [0, -far]]) : [[0.01, 0], [-0.01, 0]])).sort((a, b) => farness(a) - farness(b));

/** @typedef {{left: number, right: number, top: number, bottom: number}} Box */
/** @param {number[]} centre @param {number} half @param {number} tall @returns {Box} */
const around = ([x, y], half, tall) => ({ left: x - half, right: x + half, top: y - tall, bottom: y + tall });

/** @param {Box} a @param {Box} b */
const overlap = (a, b) => a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom;

/** Ids of the indicators that have lines. @param {Insertion} shown */
const lined = ({ indicators }) => (indicators.length > MOST_LINES ? [] : indicators.map(({ id }) => id));

/** The nearest place within the drawing. @param {number[]} place */
const inside = ([x, y]) => [Math.min(Math.max(x, 10), WIDTH - 10), Math.min(Math.max(y, 10), HEIGHT - 10)];

/** From places on the map to the drawing, as large as it can be. @param {number[][]} places */
function fitted(places) {
  const [low, high] = [Math.min, Math.max].map((end) => [0, 1].map((axis) => end(...places.map((place) => place[axis]))));
  const room = [WIDTH - 2 * MARGIN, HEIGHT - 2 * MARGIN];
  const scale = Math.min(...room.map((size, axis) => size / (high[axis] - low[axis] || 1)));
  /** @param {number[]} place */
  return ([x, y]) => [WIDTH / 2 + scale * (x - (low[0] + high[0]) / 2), HEIGHT / 2 - scale * (y - (low[1] + high[1]) / 2)]
    .map((value) => Math.round(10 * value) / 10);
}
