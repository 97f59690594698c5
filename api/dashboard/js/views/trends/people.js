// What people said of the verdicts: escapes and false rejects, as far as anybody looked.

import { h, percent } from "../../dom.js";

/** people: { confirmed, false_rejects, escapes, looked_at_ok, looked_at_rejected, undecided }. Returns {node, close}. */
export function peoplePanel({ people }, product) {
  const looked = people.looked_at_ok + people.looked_at_rejected;
  const of = (many, all) => (all ? `${percent(many / all, 1)} of the ${all} that a person looked at` : "nobody looked at any yet");
  const node = h(
    "section",
    { class: "panel", "aria-labelledby": "people-title" },
    h("h2", { id: "people-title" }, "What people said"),
    h(
      "dl",
      { class: "figures" },
      figure("Escapes", people.escapes, "OK by the machine, NG by a person", of(people.escapes, people.looked_at_ok)),
      figure("False rejects", people.false_rejects, "NG by the machine, OK by a person", of(people.false_rejects, people.looked_at_rejected)),
      figure("Confirmed", people.confirmed, "the person agreed", looked ? `of ${looked}` : "nobody looked at any yet"),
      figure("Not looked at", people.undecided, "no person decided", ""),
    ),
    h("p", { class: "note" }, "Escapes are known only as far as somebody looks at parts that are OK: look at some of them, too."),
    h("p", {}, h("a", { href: `#/inspections?product_id=${encodeURIComponent(product)}&verdict=NG` }, "Look at parts that are NG"), " · ", h("a", { href: `#/inspections?product_id=${encodeURIComponent(product)}&verdict=REVIEW` }, "REVIEW"), " · ", h("a", { href: `#/inspections?product_id=${encodeURIComponent(product)}&verdict=OK` }, "OK")),
  );
  return { node, close: () => {} };
}

const figure = (name, number, said, share) => h("div", { class: "figure" }, h("dt", {}, name), h("dd", {}, h("strong", {}, String(number)), h("span", { class: "note" }, `${said}; ${share}`.replace(/; $/, ""))));
