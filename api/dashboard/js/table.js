// A table of any number of rows, of which only those in sight are there.

import { h } from "./dom.js";

const ROW = 32; // px of a row; the style sheet says the same

/** columns: { title, text(i) -> string, number: bool }. `chosen(i)` is told where a row is clicked or entered. */
export function table({ label, columns, count, chosen, empty = "Nothing here yet." }) {
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
    room.style.height = `${Math.max(total, 1) * ROW}px`;
    return total;
  }

  function draw() {
    waits = false;
    const total = measure();
    if (!total) {
      room.replaceChildren(h("p", { class: "note" }, empty));
      return;
    }
    const first = Math.max(0, Math.floor(root.scrollTop / ROW) - 4);
    const last = Math.min(total, first + Math.ceil((root.clientHeight || 400) / ROW) + 9);
    const rows = [];
    for (let i = first; i < last; i++) rows.push(row(i));
    room.replaceChildren(...rows);
  }

  function row(i) {
    const line = h("div", { class: "vtable-row", role: "row", "aria-rowindex": i + 2, "aria-selected": String(i === current) },
      columns.map((each) => h("div", { role: "cell", class: each.number ? "number" : "" }, each.text(i))));
    line.style.top = `${i * ROW}px`;
    line.addEventListener("click", () => chosen(i));
    return line;
  }

  function soon() {
    if (!waits) requestAnimationFrame(draw);
    waits = true;
  }

  function choose(i) {
    current = i;
    measure();
    const [top, room] = [i * ROW, root.clientHeight - ROW];
    if (room > 0 && (top < root.scrollTop || top + ROW > root.scrollTop + room)) root.scrollTop = top - room / 2;
    soon();
  }

  root.addEventListener("scroll", soon, { passive: true });
  root.addEventListener("keydown", (event) => {
    const by = { ArrowDown: 1, ArrowUp: -1, PageDown: 10, PageUp: -10 }[event.key];
    if (!by || !count()) return;
    event.preventDefault();
    event.stopPropagation();
    chosen(Math.min(Math.max(current + by, 0), count() - 1));
  });
  return { root, choose, refresh: soon };
}
