"use strict";
(() => {
  const every = (selector, from = document) => Array.from(from.querySelectorAll(selector));

  /* A link opens what it leads to; print opens all. */
  function openTarget() {
    const target = document.getElementById(location.hash.slice(1));
    for (let part = target; part; part = part.parentElement) {
      if (part.tagName === "DETAILS") part.open = true;
    }
    if (target) target.scrollIntoView();
  }
  addEventListener("hashchange", openTarget);
  openTarget();
  let closed = [];
  addEventListener("beforeprint", () => {
    closed = every("details:not([open])");
    for (const part of closed) part.open = true;
  });
  addEventListener("afterprint", () => {
    for (const part of closed) part.open = false;
  });

  /* Figures: the values nearest to the pointer, or step by step with the arrow keys. */
  const tip = document.getElementById("tip");
  for (const panel of every(".panel")) {
    const { by, width, below, names, places } = JSON.parse(panel.querySelector("script").textContent);
    let current = -1;
    const show = (place) => {
      current = place;
      const [at, title, values] = places[place];
      const box = panel.querySelector("svg").getBoundingClientRect(), scale = box.width / width;
      const texts = [title, ...values.map(([name, text]) => `${names[name]} ${text}`)];
      tip.replaceChildren(...texts.map((text) => {
        const row = document.createElement("div");
        row.textContent = text;
        return row;
      }));
      tip.hidden = false;
      /* Below the axes, so that no curve is covered. */
      const left = box.left + (by === "x" ? at * scale : box.width / 2) - tip.offsetWidth / 2;
      tip.style.left = `${Math.max(4, Math.min(left, innerWidth - tip.offsetWidth - 4)) + scrollX}px`;
      tip.style.top = `${box.top + below * scale + scrollY}px`;
    };
    const nearest = (event) => {
      const box = panel.querySelector("svg").getBoundingClientRect();
      const at = (by === "x" ? event.clientX - box.left : event.clientY - box.top) * width / box.width;
      const apart = places.map((place) => Math.abs(place[0] - at));
      if (places.length) show(apart.indexOf(Math.min(...apart)));
    };
    panel.addEventListener("pointermove", nearest);
    panel.addEventListener("pointerdown", nearest);
    panel.addEventListener("pointerleave", () => { tip.hidden = true; });
    panel.addEventListener("blur", () => { tip.hidden = true; });
    panel.addEventListener("keydown", (event) => {
      const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
      if (!step || !places.length) return;
      event.preventDefault();
      show(Math.max(0, Math.min(places.length - 1, current + step)));
    });
  }

  /* Tables: a header sorts by its column, then the other way, then as it was. */
  const number = (text) => Number.parseFloat(text.replace(/,/g, "").replace("−", "-").replace("< ", ""));
  for (const table of every("table.sortable")) {
    const rows = Array.from(table.tBodies[0].rows);
    const headers = Array.from(table.tHead.rows[table.tHead.rows.length - 1].cells);
    headers.forEach((header, column) => {
      const button = document.createElement("button");
      button.type = "button";
      button.append(...header.childNodes);
      if (!button.textContent) button.setAttribute("aria-label", "Sort");
      header.append(button);
      header.setAttribute("aria-sort", "none");
      button.addEventListener("click", () => {
        const order = { none: "descending", descending: "ascending", ascending: "none" }[header.getAttribute("aria-sort")];
        for (const other of headers) other.setAttribute("aria-sort", other === header ? order : "none");
        const sign = order === "descending" ? -1 : 1;
        const value = (row) => row.cells[column].textContent.trim();
        const compared = (one, other) => {
          const [a, b] = [number(value(one)), number(value(other))];
          if (Number.isNaN(a) || Number.isNaN(b)) {
            return Number.isNaN(a) && Number.isNaN(b) ? sign * value(one).localeCompare(value(other)) : Number.isNaN(a) - Number.isNaN(b);
          }
          return sign * (a - b);
        };
        table.tBodies[0].append(...(order === "none" ? rows : [...rows].sort(compared)));
      });
    });
  }
})();
