// What a person says of a part, beside what the machine said and never in its place.

import { h, moment, replace } from "./dom.js";

/** The form, and what was said before. `told(inspection)` gets the inspection as it is afterwards. */
export function disposition({ api, inspection, allowed, told }) {
  const said = inspection.disposition;
  const opposite = inspection.verdict === "OK" ? "NG" : "OK";
  const comment = h("textarea", { name: "comment", rows: "2", maxlength: "1000", id: "disposition-comment" });
  const choice = (value, verdict, text) =>
    h("label", { class: "choice" },
      h("input", { type: "radio", name: "decision", value: `${value}:${verdict ?? ""}`, required: true }), text);
  const choices =
    inspection.verdict === "OK" || inspection.verdict === "NG"
      ? [choice("confirm", null, `Confirm: it is ${inspection.verdict}`), choice("overrule", opposite, `Overrule: it is ${opposite}`)]
      : [choice("overrule", "OK", "The part is OK"), choice("overrule", "NG", "The part is NG"),
        inspection.verdict && choice("confirm", null, `Confirm: it stays ${inspection.verdict}`)];
  const problem = h("p", { class: "problem", role: "alert", hidden: true });
  const save = h("button", { type: "submit", class: "main" }, "Save");
  const form = h("form", { class: "disposition-form" },
    h("fieldset", {}, h("legend", { class: "note" }, "Your decision"), choices),
    h("label", { for: "disposition-comment" }, "Comment"),
    comment,
    save,
    problem);

  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    const [decision, verdict] = new FormData(form).get("decision").split(":");
    save.disabled = true;
    problem.hidden = true;
    try {
      const asked = { decision, comment: comment.value };
      if (verdict) asked.verdict = verdict;
      told(await api.post(`/v1/inspections/${inspection.inspection_id}/disposition`, asked));
    } catch (error) {
      problem.textContent = error.detail ?? error.message;
      problem.hidden = false;
      save.disabled = false;
    }
  });

  const before = said
    ? h("p", { class: "disposition-said" }, inWords(said, inspection), said.comment ? h("q", {}, said.comment) : null)
    : h("p", { class: "note" }, "Nobody has looked at this part yet.");
  return h("section", { class: "panel disposition", "aria-label": "Disposition" },
    h("h2", {}, "A person’s decision"),
    before,
    said ? earlier(api, inspection) : null,
    allowed ? (said ? h("details", {}, h("summary", {}, "Decide again"), form) : form) : null);
}

/** What was said before the last word; nothing is seen of it where that was the first. */
function earlier(api, inspection) {
  const list = h("ul", {});
  const room = h("details", { class: "disposition-earlier", hidden: true }, h("summary", {}, "Earlier decisions"), list);
  api.list(`/v1/inspections/${inspection.inspection_id}/dispositions`, { most: 200 }).then(
    ([, ...before]) => {
      room.hidden = before.length === 0;
      room.firstChild.textContent = `Earlier decisions: ${before.length}`;
      replace(list, before.map((each) => h("li", {}, inWords(each, inspection), each.comment ? h("q", {}, each.comment) : null)));
    },
    (problem) => {
      room.hidden = false;
      replace(list, h("li", { class: "problem" }, problem.detail ?? String(problem)));
    },
  );
  return room;
}

function inWords(said, inspection) {
  const what = said.decision === "confirm" ? `Confirmed ${inspection.verdict}` : `Overruled: ${said.verdict}`;
  return `${what}, by ${said.actor}, ${moment(said.t_ns)}. `;
}
