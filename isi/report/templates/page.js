"use strict";
(() => {
  const every = (selector, from = document) => Array.from(from.querySelectorAll(selector));

  /* Parts: a link opens what it leads to, print opens all and closes again what was closed. */
  function openAround(element) {
    for (let part = element; part; part = part.parentElement) {
      if (part.tagName === "DETAILS") part.open = true;
    }
  }

  function decoded(text) { // an address may be cut off within a letter
    try {
      return decodeURIComponent(text);
    } catch {
      return text;
    }
  }

  function openTarget() {
    const target = document.getElementById(decoded(location.hash.slice(1)));
    if (!target) return;
    openAround(target);
    const own = target.querySelector(":scope > details:not(.words)");
    if (own) own.open = true;
    target.scrollIntoView();
    markRead();
  }

  let closed = [];
  addEventListener("hashchange", openTarget);
  addEventListener("beforeprint", () => {
    closed = every("details:not([open])");
    for (const part of closed) part.open = true;
  });
  addEventListener("afterprint", () => {
    for (const part of closed) part.open = false;
  });
  for (const [id, open] of [["open-all", true], ["close-all", false]]) {
    const button = document.getElementById(id);
    button.hidden = false;
    button.addEventListener("click", () => {
      for (const part of every("main details:not(.words)")) part.open = open;
    });
  }
  for (const link of every("nav a[href^='#']")) {
    link.addEventListener("click", () => {
      if (link.hash === location.hash) openTarget(); // again, when its part was closed since
    });
  }

  /* Tables: a header sorts by its column, then the other way, then as it was. */
  const LAST = Symbol("what is not there");

  function value(row, column, numbers) {
    const text = row.cells[column].textContent.trim();
    if (text === "" || text === "–") return LAST;
    if (!numbers) return text;
    const number = Number.parseFloat(text.replace(/,/g, "").replace("−", "-").replace(/^[<×]\s*/, ""));
    return Number.isNaN(number) ? LAST : number;
  }

  function sort(table, header, column) {
    const body = table.tBodies[0];
    const numbers = !header.classList.contains("t");
    const before = header.getAttribute("aria-sort");
    const [first, second] = numbers ? ["descending", "ascending"] : ["ascending", "descending"];
    const order = before === first ? second : before === second ? "none" : first;
    for (const other of every("th[aria-sort]", table)) other.setAttribute("aria-sort", "none");
    header.setAttribute("aria-sort", order);
    const rows = Array.from(body.rows);
    for (const name of every(".same", table)) name.classList.remove("hidden");
    rows.forEach((row, place) => { row.dataset.place ??= String(place); });
    const sign = order === "descending" ? -1 : 1;
    rows.sort((one, other) => {
      const [a, b] = [value(one, column, numbers), value(other, column, numbers)];
      const asItWas = Number(one.dataset.place) - Number(other.dataset.place);
      if (order === "none" || a === b) return asItWas;
      if (a === LAST) return 1;
      if (b === LAST) return -1;
      return sign * (numbers ? a - b : a.localeCompare(b)) || asItWas;
    });
    body.append(...rows);
  }

  for (const table of every("table.sortable")) {
    const headers = Array.from(table.tHead.rows[table.tHead.rows.length - 1].cells);
    headers.forEach((header, column) => {
      const button = document.createElement("button");
      button.type = "button";
      button.setAttribute("aria-label", `Sort by ${header.textContent.trim()}`);
      header.append(button);
      header.setAttribute("aria-sort", "none");
      header.addEventListener("click", (event) => {
        if (!event.target.closest("a")) sort(table, header, column); // the button or beside it
      });
    });
  }

  /* Words: what they mean, to whoever points at them or comes to them by keyboard. */
  const tip = document.getElementById("tip");
  let asked = null;

  function show(link) {
    const term = document.getElementById(link.hash.slice(1));
    if (!term) return;
    hide();
    asked = link;
    tip.textContent = term.nextElementSibling.textContent;
    tip.hidden = false;
    link.setAttribute("aria-describedby", "tip");
    const place = link.getBoundingClientRect();
    const left = Math.min(place.left, document.documentElement.clientWidth - tip.offsetWidth - 8);
    const below = place.bottom + tip.offsetHeight + 8 < innerHeight || place.top < tip.offsetHeight + 8;
    tip.style.left = `${Math.max(8, left) + scrollX}px`;
    tip.style.top = `${(below ? place.bottom + 4 : place.top - tip.offsetHeight - 4) + scrollY}px`;
  }

  function hide() {
    tip.hidden = true;
    if (asked) asked.removeAttribute("aria-describedby");
    asked = null;
  }

  for (const link of every("a.term")) {
    link.addEventListener("mouseenter", () => show(link));
    link.addEventListener("focus", () => show(link));
    link.addEventListener("mouseleave", (event) => { if (asked === link && event.relatedTarget !== tip) hide(); });
    link.addEventListener("blur", hide);
    link.addEventListener("click", (event) => { event.preventDefault(); show(link); });
  }
  tip.addEventListener("mouseleave", hide);
  addEventListener("keydown", (event) => { if (event.key === "Escape") hide(); });

  /* The contents: open where they stand beside the page; what is in sight is marked. */
  const contents = document.querySelector("nav details");
  const wide = matchMedia("(min-width: 72rem)");
  const unfold = () => { contents.open = wide.matches; };
  unfold();
  wide.addEventListener("change", unfold);
  const links = new Map(every("nav li a").map((link) => [link.hash.slice(1), link]));
  const sections = Array.from(links.keys(), (id) => document.getElementById(id));
  function markRead() { /* the last section at the top or above it; at the end of the page the one that was asked for */
    const top = (section) => section.getBoundingClientRect().top;
    const atEnd = innerHeight + scrollY >= document.documentElement.scrollHeight - 2;
    const target = atEnd && sections.find((section) => `#${section.id}` === location.hash && top(section) >= 0);
    const read = target || sections.filter((section) => top(section) <= 24).pop();
    for (const [id, link] of links) {
      if (read && id === read.id) link.setAttribute("aria-current", "true");
      else link.removeAttribute("aria-current");
    }
  }
  let waiting = false;
  addEventListener("scroll", () => {
    if (!waiting) requestAnimationFrame(() => { waiting = false; markRead(); });
    waiting = true;
  });
  openTarget();
})();
