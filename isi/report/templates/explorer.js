"use strict";
/* The explorer: shows one entity of the data at a time. What is shown stands in the address, as #explorer/NAME/MODEL.
   Text of the data becomes text nodes alone. */
(() => {
  const data = JSON.parse(document.getElementById("explorer-data").textContent);
  const at = (id) => document.getElementById(`explorer-${id}`);
  const box = at("box"), input = at("entity"), list = at("list");
  const ids = Object.keys(data.entities).map(Number).sort((a, b) => data.names[a].localeCompare(data.names[b]));
  const MOST = 12;  /* further true answers that are shown without a click */
  const MARKS = [null, "insert triple", "trained", "held out"];
  const FALLBACKS = { es: "it falls back on words alone", rs: "it falls back on relations alone", centroid: "it falls back on all that are known" };
  let entity = data.start, model = data.models.length - 1, options = [], active = -1;

  /* Elements: what they hold is text or other elements. */
  const SVG = "http://www.w3.org/2000/svg";
  const fill = (node, attributes, children) => {
    for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
    node.append(...children);
    return node;
  };
  const html = (tag, attributes = {}, ...children) => fill(document.createElement(tag), attributes, children);
  const svg = (tag, attributes = {}, ...children) => fill(document.createElementNS(SVG, tag), attributes, children);
  const shapes = {
    at_once: (x, y, size) => svg("circle", { cx: x, cy: y, r: size }),
    trained: (x, y, size) => svg("rect", { x: x - size, y: y - size, width: 2 * size, height: 2 * size }),
    joint: (x, y, size) => svg("path", { d: `M${x} ${y - size}l${.8 * size} ${size}l${-.8 * size} ${size}l${-.8 * size} ${-size}z` }),
    indicator: (x, y, size) => svg("path", { d: `M${x} ${y - size}l${size} ${1.8 * size}h${-2 * size}z` }),
  };
  const two = (hundredths) => hundredths === null ? "–" : (hundredths / 100).toFixed(2).replace("-", "−");
  const mark = (status) => html("span", { class: status === 3 ? "ex-mark ex-held" : "ex-mark" }, MARKS[status]);
  const marked = (answer, status) => status
    ? [html("strong", {}, `✓ ${data.names[answer]}`), " ", mark(status)] : [data.names[answer]];

  /* The combobox: a list below the field, through which arrows go (pattern of WAI-ARIA). */
  const shut = () => {
    list.hidden = true;
    active = -1;
    input.setAttribute("aria-expanded", "false");
    input.removeAttribute("aria-activedescendant");
  };
  const suggest = (typed) => {
    const wanted = typed.trim().toLowerCase();
    const place = (id) => data.names[id].toLowerCase().indexOf(wanted);
    options = ids.filter((id) => place(id) >= 0).sort((a, b) => Math.min(place(a), 1) - Math.min(place(b), 1));
    list.replaceChildren(...options.map((id, number) => {
      const item = html("li", { role: "option", id: `explorer-option-${number}`, "aria-selected": "false" },
        data.names[id], " ", html("small", {}, data.kinds[id]));
      item.addEventListener("mousedown", (event) => { event.preventDefault(); choose(id); });
      return item;
    }));
    if (!options.length) list.append(html("li", { "aria-disabled": "true" }, "no inserted entity has this name"));
    list.hidden = false;
    active = -1;
    input.setAttribute("aria-expanded", "true");
    input.removeAttribute("aria-activedescendant");
  };
  const move = (to) => {
    if (!options.length) return;
    if (active >= 0) list.children[active].setAttribute("aria-selected", "false");
    active = (to + options.length) % options.length;
    const item = list.children[active];
    item.setAttribute("aria-selected", "true");
    input.setAttribute("aria-activedescendant", item.id);
    item.scrollIntoView({ block: "nearest" });
  };
  const choose = (id) => {
    entity = id;
    shut();
    input.value = data.names[id];
    input.select();
    remember();
    draw();
  };
  input.addEventListener("input", () => suggest(input.value));
  input.addEventListener("click", () => { if (list.hidden) { input.select(); suggest(""); } });
  input.addEventListener("blur", () => { shut(); input.value = data.names[entity]; });
  input.addEventListener("keydown", (event) => {
    const open = !list.hidden;
    if (event.key === "ArrowDown" || event.key === "ArrowUp") {
      if (!open) suggest("");
      move(event.key === "ArrowDown" ? active + 1 : (active < 0 ? 0 : active) - 1);
    } else if (event.key === "Enter" && open && options.length) {
      choose(active < 0 && input.value === data.names[entity] ? entity : options[Math.max(active, 0)]);
    } else if (event.key === "Escape") { shut(); input.value = data.names[entity]; }
    else return;
    event.preventDefault();
  });

  /* Insert triples and indicators. */
  const asked = (query, known, unknown) => {
    const ends = query.hidden ? [unknown, known] : [known, unknown];
    return `${ends[0]} ${data.relations[query.relation]} ${ends[1]}`;
  };
  const drawFacts = (own) => {
    at("name").textContent = `${data.names[entity]} (${data.kinds[entity]})`;
    const facts = own.queries.flatMap((query) => query.true.filter((_, number) => query.status[number] === 1)
      .map((answer) => asked(query, data.names[entity], data.names[answer])));
    at("told").textContent = `Inserted by seed ${own.seed}. Insert triples: ${facts.join("; ") || "none"}.`;
  };
  const row = (kind, cells) => html("tr", {}, ...cells.map((cell, number) => number
    ? html(kind, kind === "th" ? { scope: "col" } : {}, cell) : html("th", { scope: kind === "th" ? "col" : "row" }, cell)));
  const indicatorTable = (found, label) => {
    const weight = found.weight ? ["weight"] : [], shown = found.ids.slice(0, 9);
    return html("table", {}, html("caption", {}, label),
      html("thead", {}, row("th", ["entity", ...weight, "words", "relations"])),
      html("tbody", {}, ...shown.map((id, number) => row("td", [data.names[id], ...weight.map(() => `${found.weight[number]} %`),
        two(found.words[number]), two(found.relations[number])]))));
  };
  const drawIndicators = (own) => at("indicators").replaceChildren(...data.models.flatMap(({ label }, number) => {
    const found = own.indicators[number];
    if (!found) return [];
    const rest = found.ids.slice(9).map((id) => data.names[id]);
    const parts = [indicatorTable(found, label)];
    if (rest.length) parts.push(html("p", {}, `and ${rest.join(", ")}`));
    if (found.fallback) parts.push(html("p", {}, `(${FALLBACKS[found.fallback]})`));
    return [html("div", { class: number === model ? "ex-chosen" : "" }, ...parts)];
  }));

  /* The map: what is drawn on it is larger where the page is narrow. */
  const narrow = window.matchMedia("(max-width: 40rem)");
  const [WIDTH, HEIGHT, MARGIN] = [640, 440, 26];
  const onto = (places) => {  /* from coordinates to the drawing, as large as it can be */
    const [lowest, highest] = ["min", "max"].map((end) => [0, 1].map((axis) => Math[end](...places.map((place) => place[axis]))));
    const middle = [0, 1].map((axis) => (lowest[axis] + highest[axis]) / 2);
    const scale = Math.min((WIDTH - 2 * MARGIN) / (highest[0] - lowest[0] || 1), (HEIGHT - 2 * MARGIN) / (highest[1] - lowest[1] || 1));
    const rounded = (value) => Math.round(10 * value) / 10;
    return (place) => [rounded(WIDTH / 2 + scale * (place[0] - middle[0])), rounded(HEIGHT / 2 - scale * (place[1] - middle[1]))];
  };
  const labels = (zoom) => {  /* right of a point, left, above or below, where nothing else is written; else nowhere */
    const taken = [];
    return (text, [x, y], style) => {
      const apart = (style ? 10 : 6) * zoom, width = (style ? 7.5 : 6.2) * zoom * text.length;
      const spots = [[apart, 4 * zoom], [-apart - width, 4 * zoom], [-width / 2, -apart - 1], [-width / 2, apart + 9 * zoom]];
      const free = spots.map(([across, down]) => [x + across, y + down]).find(([left, base]) => left > 0 && left + width < WIDTH
        && taken.every(([start, line, long]) => left > start + long || start > left + width || Math.abs(base - line) > 11 * zoom));
      if (!free) return [];
      taken.push([...free, width]);
      return [svg("text", { x: free[0], y: free[1], class: style }, text)];
    };
  };
  const named = (node, text, attributes) => fill(node, attributes, [svg("title", {}, text)]);
  const moved = (own, number, to, zoom) => {  /* an entity immediately and after training, with a line between */
    const [start, end] = own.places.slice(1 + 2 * number, 3 + 2 * number).map(to), chosen = number === model;
    const { label, colour } = data.models[number], style = { fill: colour, stroke: "var(--paper)", "stroke-width": .8 };
    return svg("g", { class: chosen ? "" : "ex-other" },
      svg("line", { x1: start[0], y1: start[1], x2: end[0], y2: end[1], stroke: colour, "stroke-width": chosen ? 2 : 1 }),
      named(shapes.at_once(...start, (chosen ? 7 : 4.5) * zoom), `${data.names[entity]}, immediately, by ${label}`, style),
      named(shapes.trained(...end, (chosen ? 5 : 3.5) * zoom), `${data.names[entity]}, after ${data.epochs} epochs, from ${label}`, style));
  };
  const drawMap = (own) => {
    const seed = data.maps[own.seed], known = new Map(seed.known.map((id, number) => [id, seed.at[number]]));
    const zoom = narrow.matches ? 1.5 : 1, to = onto([...seed.at, ...own.places]), write = labels(zoom);
    const { colour, label } = data.models[model], name = data.names[entity];
    const indicators = own.indicators[model] ? own.indicators[model].ids : [];
    const others = data.models.map((_, number) => number).filter((number) => number !== model);
    fill(at("map"), {
      "aria-label": `Map of the ${known.size} known entities, with ${name} as ${label} puts it, after training, and in the joint model.`,
    }, []).replaceChildren(
      ...[...known].map(([id, place]) => named(shapes.at_once(...to(place), 2.6 * zoom), data.names[id], { class: "ex-known" })),
      ...[...others, model].map((number) => moved(own, number, to, zoom)),
      named(shapes.joint(...to(own.places[0]), 8 * zoom), `${name}, ${data.joint} model`, { class: "ex-joint" }),
      ...indicators.map((id) => named(shapes.indicator(...to(known.get(id)), 5 * zoom), data.names[id], { class: "ex-indicator", fill: colour })),
      ...write(name, to(own.places[1 + 2 * model]), "ex-name"),
      ...indicators.flatMap((id) => write(data.names[id], to(known.get(id)), "")),
    );
    drawKey(seed, colour, label);
  };
  const drawKey = (seed, colour, label) => {
    const key = (shape, text, paint) => html("li", {}, svg("svg", { viewBox: "0 0 14 14", "aria-hidden": "true" },
      fill(shapes[shape](7, 7, 5), { fill: paint }, [])), text);
    at("legend").replaceChildren(
      key("at_once", "known entity", "var(--soft)"), key("indicator", `indicator of ${label}`, colour),
      key("at_once", `immediately, by ${label}`, colour), key("trained", `after ${data.epochs} epochs`, colour),
      key("joint", `${data.joint} model`, "var(--ink)"), html("li", {}, "fainter: from other initializers"),
    );
    at("caption").textContent = `The known entities as Θ⁰ has them, on its two principal axes, which hold ${seed.shown} % of their `
      + `variance: what lies close here may be far apart. The ${data.joint.toLowerCase()} model has coordinates of its own; they are `
      + "turned and scaled so that its known entities come as close to Θ⁰'s as they can, which accounts for "
      + `${seed.fitted} % of the variance.`;
  };

  /* The answers. */
  const answerList = (query, step, heading) => {
    const status = new Map(query.true.map((answer, number) => [answer, query.status[number]]));
    const first = query.first[step];
    const later = query.true.map((answer, number) => [query.ranks[step][number], answer])
      .filter(([rank]) => rank > first.length).sort((a, b) => a[0] - b[0]);
    const lines = first.map((answer) => html("li", {}, ...marked(answer, status.get(answer))));
    const parts = [html("p", {}, heading), html("ol", {}, ...lines)];
    const further = later.map(([rank, answer]) => `${rank} ${data.names[answer]} (${MARKS[status.get(answer)]})`);
    if (further.length) parts.push(html("p", {}, `Further true ones: ${further.slice(0, MOST).join(", ")}`));
    if (further.length > MOST) {
      const more = html("summary", {}, `and ${further.length - MOST} more`);
      parts.push(html("details", {}, more, html("p", {}, further.slice(MOST).join(", "))));
    }
    return html("div", {}, ...parts);
  };
  const drawAnswers = (own) => {
    const { label } = data.models[model];
    const drawn = own.queries.map((query) => html("div", { class: "ex-query" },
      html("h6", {}, asked(query, data.names[entity], "?"), query.true.length ? "" : " (nothing is true)"),
      html("div", { class: "ex-columns" }, answerList(query, 1 + 2 * model, `Immediately, by ${label}`),
        answerList(query, 2 + 2 * model, `After ${data.epochs} epochs, from ${label}`),
        answerList(query, 0, `${data.joint} model`))));
    const vain = drawn.filter((_, number) => !own.queries[number].true.length);
    const useful = drawn.filter((node) => !vain.includes(node));
    const heading = html("summary", {}, "Queries of its kind without true answers");
    if (vain.length) useful.push(html("details", {}, heading, ...vain));
    at("answers").replaceChildren(...useful);
  };
  const draw = () => [drawFacts, drawIndicators, drawMap, drawAnswers].forEach((part) => part(data.entities[entity]));

  /* The address. */
  const encoded = (id) => encodeURIComponent(data.names[id]);
  const remember = () => history.replaceState(null, "", `#explorer/${encoded(entity)}/${data.models[model].name}`);
  const recall = () => {
    const [section, name, by] = location.hash.slice(1).split("/");
    if (section !== "explorer" || name === undefined) return;
    const id = ids.find((one) => encoded(one) === name), number = data.models.findIndex((one) => one.name === by);
    if (id !== undefined) entity = id;
    if (number >= 0) model = number;
    input.value = data.names[entity];
    at("models").querySelectorAll("input")[model].checked = true;
    draw();
    for (let around = box; around; around = around.parentElement) if (around.tagName === "DETAILS") around.open = true;
    box.scrollIntoView();
  };
  data.models.forEach(({ label }, number) => {
    const radio = html("input", { type: "radio", name: "explorer-model", value: String(number) });
    radio.checked = number === model;
    radio.addEventListener("change", () => { model = number; remember(); draw(); });
    at("models").append(html("label", {}, radio, label));
  });
  input.value = data.names[entity];
  box.hidden = false;
  draw();
  recall();
  window.addEventListener("hashchange", recall);
  narrow.addEventListener("change", draw);
})();
