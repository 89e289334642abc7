"use strict";
/* The explorer: shows one entity of the data at a time. What is shown stands in the address, as #explorer/NAME/MODEL.
   Text of the data becomes text nodes alone. */
(() => {
  const data = JSON.parse(document.getElementById("explorer-data").textContent);
  const at = (id) => document.getElementById(`explorer-${id}`);
  const box = at("box"), input = at("entity"), list = at("list");
  const ids = Object.keys(data.entities).map(Number).sort((a, b) => data.names[a].localeCompare(data.names[b]));
  const MOST = 12;  /* further answers that are shown unasked */
  const MARKS = [null, "told", "trained", "held out"];
  const FALLBACKS = { es: "by words alone", rs: "by relations alone", centroid: "all that are known" };
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
    joint: (x, y, size) => svg("path", { d: `M${x} ${y - 1.4 * size}l${size} ${1.4 * size}l${-size} ${1.4 * size}l${-size} ${-1.4 * size}z` }),
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
    if (!options.length) list.append(html("li", { "aria-disabled": "true" }, "none of this name is in a set"));
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
    } else if (event.key === "Enter" && open && options.length) choose(options[Math.max(active, 0)]);
    else if (event.key === "Escape") { shut(); input.value = data.names[entity]; }
    else return;
    event.preventDefault();
  });

  /* What was told, and who indicates. */
  const asked = (query, known, unknown) => {
    const ends = query.hidden ? [unknown, known] : [known, unknown];
    return `${ends[0]} ${data.relations[query.relation]} ${ends[1]}`;
  };
  const drawFacts = (own) => {
    at("name").textContent = `${data.names[entity]} (${data.kinds[entity]})`;
    const facts = own.queries.flatMap((query) => query.true.filter((_, number) => query.status[number] === 1)
      .map((answer) => asked(query, data.names[entity], data.names[answer])));
    at("told").textContent = `Inserted by seed ${own.seed}. Told: ${facts.join("; ") || "nothing"}.`;
  };
  const indicatorTable = (found, weighed) => html("table", {},
    html("thead", {}, html("tr", {}, html("th", { scope: "col" }, "entity"),
      ...[...(weighed ? ["weight"] : []), "words", "relations"].map((name) => html("th", { scope: "col", class: "n" }, name)))),
    html("tbody", {}, ...found.ids.slice(0, 9).map((id, number) => html("tr", {}, html("td", {}, data.names[id]),
      ...(weighed ? [html("td", { class: "n" }, `${found.weight[number]} %`)] : []),
      html("td", { class: "n" }, two(found.words[number])), html("td", { class: "n" }, two(found.relations[number]))))));
  const drawIndicators = (own) => at("indicators").replaceChildren(...data.models.flatMap(({ label }, number) => {
    const found = own.indicators[number];
    if (!found) return [];
    const weighed = found.weight.some((weight) => weight !== found.weight[0]);
    const rest = found.ids.slice(9).map((id) => data.names[id]);
    const parts = [html("h5", {}, label), indicatorTable(found, weighed)];
    if (rest.length) parts.push(html("p", {}, `and ${rest.join(", ")}`));
    if (found.fallback) parts.unshift(html("p", {}, `Fell back: ${FALLBACKS[found.fallback]}.`));
    return [html("div", { class: number === model ? "ex-chosen" : "" }, ...parts)];
  }));

  /* The map: what is drawn on it is larger where the page is narrow. */
  const narrow = window.matchMedia("(max-width: 40rem)");
  const drawMap = (own) => {
    const zoom = narrow.matches ? 1.5 : 1;
    const seed = data.maps[own.seed], known = new Map(seed.known.map((id, number) => [id, seed.at[number]]));
    const every = [...seed.at, ...own.places], margin = 26;
    const [left, low] = [0, 1].map((axis) => Math.min(...every.map((place) => place[axis])));
    const [right, high] = [0, 1].map((axis) => Math.max(...every.map((place) => place[axis])));
    const scale = Math.min((640 - 2 * margin) / (right - left || 1), (440 - 2 * margin) / (high - low || 1));
    const x = (place) => Math.round(10 * (320 + scale * (place[0] - (left + right) / 2))) / 10;
    const y = (place) => Math.round(10 * (220 - scale * (place[1] - (low + high) / 2))) / 10;
    const named = (node, text, attributes = {}) => fill(node, attributes, [svg("title", {}, text)]);
    const nodes = [...known].map(([id, place]) => named(shapes.at_once(x(place), y(place), 2.6 * zoom), data.names[id], { class: "ex-known" }));
    const colour = data.models[model].colour, label = data.models[model].label;
    const texts = [], taken = [];
    /* Right of its place, left, above or below, where nothing else is written; nowhere if there is no room. */
    const write = (text, place, style) => {
      const apart = (style ? 10 : 6) * zoom, width = (style ? 7.5 : 6.2) * zoom * text.length;
      const spots = [[apart, 4 * zoom], [-apart - width, 4 * zoom], [-width / 2, -apart - 1], [-width / 2, apart + 9 * zoom]];
      const free = spots.map(([dx, dy]) => [x(place) + dx, y(place) + dy]).find(([tx, ty]) => tx > 0 && tx + width < 640
        && taken.every(([ox, oy, other]) => tx > ox + other || ox > tx + width || Math.abs(ty - oy) > 11 * zoom));
      if (!free) return;
      taken.push([...free, width]);
      texts.push(svg("text", { x: free[0], y: free[1], class: style }, text));
    };
    const order = data.models.map((_, number) => number).filter((number) => number !== model);
    for (const number of [...order, model]) {
      const [start, end] = own.places.slice(1 + 2 * number, 3 + 2 * number), chosen = number === model;
      const style = { fill: data.models[number].colour, stroke: "var(--paper)", "stroke-width": .8 };
      const parts = [
        svg("line", { x1: x(start), y1: y(start), x2: x(end), y2: y(end), stroke: style.fill, "stroke-width": chosen ? 2 : 1 }),
        named(shapes.at_once(x(start), y(start), (chosen ? 7 : 4.5) * zoom), `${data.names[entity]}, at once, by ${data.models[number].label}`, style),
        named(shapes.trained(x(end), y(end), (chosen ? 5 : 3.5) * zoom), `${data.names[entity]}, after ${data.epochs} epochs, from ${data.models[number].label}`, style),
      ];
      nodes.push(svg("g", { class: chosen ? "" : "ex-other" }, ...parts));
    }
    const joint = own.places[0];
    nodes.push(named(shapes.joint(x(joint), y(joint), 6 * zoom), `${data.names[entity]}, ${data.joint} model`, { class: "ex-joint" }));
    write(data.names[entity], own.places[1 + 2 * model], "ex-name");
    for (const id of own.indicators[model] ? own.indicators[model].ids : []) {
      const place = known.get(id);
      nodes.push(named(shapes.indicator(x(place), y(place), 5 * zoom), data.names[id], { class: "ex-indicator", fill: colour }));
      write(data.names[id], place, "");
    }
    const map = at("map");
    map.setAttribute("aria-label", `Map of the ${known.size} known entities, with ${data.names[entity]} as ${label} puts it, after training, and in the joint model.`);
    map.replaceChildren(...nodes, ...texts);
    const key = (shape, text, paint) => html("li", {}, svg("svg", { viewBox: "0 0 14 14", "aria-hidden": "true" },
      fill(shapes[shape](7, 7, 4.5), { fill: paint }, [])), text);
    at("legend").replaceChildren(key("at_once", "known entity", "var(--soft)"), key("indicator", `indicator of ${label}`, colour),
      key("at_once", `at once, by ${label}`, colour), key("trained", `after ${data.epochs} epochs`, colour),
      key("joint", `${data.joint} model`, "var(--ink)"), html("li", {}, "fainter: from other initializers"));
    at("caption").textContent = `The known entities as Θ⁰ has them, on its two principal axes, which hold ${seed.shown} % of their variance: `
      + `what lies close here may be far apart. The ${data.joint.toLowerCase()} model has coordinates of its own; they are turned and scaled so that `
      + `its known entities come as close to Θ⁰'s as they can, which accounts for ${seed.fitted} % of the variance.`;
  };

  /* The answers. */
  const answerList = (query, step, heading) => {
    const status = new Map(query.true.map((answer, number) => [answer, query.status[number]]));
    const first = query.first[step];
    const later = query.true.map((answer, number) => [query.ranks[step][number], answer])
      .filter(([rank]) => rank > first.length).sort((a, b) => a[0] - b[0]);
    const parts = [html("h6", {}, heading), html("ol", {}, ...first.map((answer) => html("li", {}, ...marked(answer, status.get(answer)))))];
    const told = later.map(([rank, answer]) => `${rank} ${data.names[answer]} (${MARKS[status.get(answer)]})`);
    if (told.length) parts.push(html("p", {}, `Further true ones: ${told.slice(0, MOST).join(", ")}`));
    if (told.length > MOST) {
      parts.push(html("details", {}, html("summary", {}, `and ${told.length - MOST} more`), html("p", {}, told.slice(MOST).join(", "))));
    }
    return html("div", {}, ...parts);
  };
  const drawAnswers = (own) => {
    const { label } = data.models[model];
    const drawn = own.queries.map((query) => html("div", { class: "ex-query" },
      html("h5", {}, asked(query, data.names[entity], "?"), query.true.length ? "" : " (nothing is true)"),
      html("div", { class: "ex-columns" }, answerList(query, 1 + 2 * model, `At once, by ${label}`),
        answerList(query, 2 + 2 * model, `After ${data.epochs} epochs, from ${label}`), answerList(query, 0, `${data.joint} model`))));
    const vain = drawn.filter((_, number) => !own.queries[number].true.length);
    const useful = drawn.filter((node) => !vain.includes(node));
    if (vain.length) useful.push(html("details", {}, html("summary", {}, "Asked of its kind, with nothing true of it"), ...vain));
    at("answers").replaceChildren(...useful);
  };
  const draw = () => [drawFacts, drawIndicators, drawMap, drawAnswers].forEach((part) => part(data.entities[entity]));

  /* The address. */
  const remember = () => history.replaceState(null, "", `#explorer/${encodeURIComponent(data.names[entity])}/${data.models[model].name}`);
  const recall = () => {
    const [section, name, by] = location.hash.slice(1).split("/");
    if (section !== "explorer" || name === undefined) return;
    const id = ids.find((one) => encodeURIComponent(data.names[one]) === name), number = data.models.findIndex((one) => one.name === by);
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
