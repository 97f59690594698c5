// A table of any number of rows, of which only those in sight are there.

import { h } from "./dom.js";

/**
 * columns: { title, text(i) -> string or node, number: bool }. `chosen(i)` is told where a row is clicked or entered,
 * `moved(i)` where arrows go to it. `row`: its height in px, as the style sheet has it. `near()` is told when the last
 * rows come into sight.
 */
export function table({ label, columns, count, chosen, moved = chosen, row: tall = 32, near = () => {}, empty = "Nothing here yet." }) {
  const head = h("div", { class: "vtable-row vtable-head", role: "row" },
    columns.map((each) => h("div", { role: "columnheader", class: each.number ? "number" : "" }, each.title)));
  const room = h("div", { class: "vtable-room", role: "rowgroup" });
  const root = h("div", { class: "vtable", role: "table", tabindex: "0", "aria-label": label }, head, room);
  root.style.setProperty("--columns", columns.length);
  let current = -1;
  let waits = false;

  function measure() {
    const total = count();
    root.setAttribute("aria-rowcount", total + 1);
    room.style.height = `${Math.max(total, 1) * tall}px`;
    return total;
  }

  function draw() {
    waits = false;
    const total = measure();
    if (!total) {
      room.replaceChildren(h("p", { class: "note" }, empty));
      return;
    }
    const first = Math.max(0, Math.floor(root.scrollTop / tall) - 4);
    const last = Math.min(total, first + Math.ceil((root.clientHeight || 400) / tall) + 9);
    const rows = [];
    for (let i = first; i < last; i++) rows.push(row(i));
    room.replaceChildren(...rows);
    if (last === total) near();
  }

  function row(i) {
    const line = h("div", { class: "vtable-row", role: "row", "aria-rowindex": i + 2, "aria-selected": String(i === current) },
      columns.map((each) => h("div", { role: "cell", class: each.number ? "number" : "" }, each.text(i))));
    line.style.top = `${i * tall}px`;
    line.addEventListener("click", (event) => event.target.closest("a") || chosen(i));
    return line;
  }

  function soon() {
    if (!waits) requestAnimationFrame(draw);
    waits = true;
  }

  function choose(i) {
    current = i;
    measure();
    const [top, height] = [i * tall, root.clientHeight - head.offsetHeight - tall];
    if (height > 0 && (top < root.scrollTop || top > root.scrollTop + height)) root.scrollTop = top - height / 2;
    soon();
  }

  root.addEventListener("scroll", soon, { passive: true });
  root.addEventListener("keydown", (event) => {
    if (event.target !== root || !count()) return;
    const last = count() - 1;
    const to = { ArrowDown: current + 1, ArrowUp: current - 1, PageDown: current + 10, PageUp: current - 10, Home: 0, End: last }[event.key];
    if (to === undefined && !(event.key === "Enter" && current >= 0)) return;
    event.preventDefault();
    event.stopPropagation();
    if (to === undefined) chosen(current);
    else moved(Math.min(Math.max(to, 0), last));
  });
  return { root, choose, refresh: soon, current: () => current };
}
