// Golden sweeps: uploaded, ticked in order, learnt from with progress; and what was learnt of them.

import { get, list, post, url } from "../../api.js";
import { empty, failed, h, moment, replace, waiting } from "../../dom.js";
import { followJob } from "./job.js";
import { learntPanel } from "./learnt.js";
import { upload } from "./upload.js";

const PAGE = 50;

export function learningPanel(recipe, app) {
  const why = recipe.forbids("engineer");
  const table = h("div", { class: "scroll" }, waiting("Reading the sweeps"));
  const picked = [];
  const jobs = h("div", { class: "jobs", "aria-live": "polite" });
  const addTo = h(
    "select",
    { id: "learn-to", disabled: Boolean(why) },
    h("option", { value: "" }, "anew"),
    recipe.appearances.map((each) => h("option", { value: each.appearance_id }, `added to ${recipe.named(each.appearance_id)}`)),
  );
  const learn = h("button", { type: "button", class: "main", onclick: begin });
  const shown = learntPanel(recipe, app);
  const ends = [];
  let sweeps = [];
  let next = null;

  async function more(from) {
    const page = await get(url(`${recipe.path}/sweeps`, { limit: PAGE, after: from }));
    sweeps = from === undefined ? page.items : [...sweeps, ...page.items];
    next = page.next;
    draw();
  }

  const read = () =>
    more().catch((problem) => {
      // A product comes into being with its first sweep.
      if (problem.status === 404) draw();
      else replace(table, failed(problem, read));
    });

  function draw() {
    const n = picked.length;
    const adding = addTo.value !== "";
    learn.textContent = n ? `Learn from ${n} sweep${n === 1 ? "" : "s"}` : "Learn";
    learn.disabled = Boolean(why) || !n;
    learn.title = why ?? (n ? "" : "Tick the sweeps of good parts first; the first is the map.");
    if (!sweeps.length) {
      replace(table, empty("No sweep yet", "Record one good part and upload the recording, above or from where it was recorded:", `inspector record --camera opencv:0 --out golden.mcap --seconds 10`));
      return;
    }
    const head = ["Use", "Part", "Frames", "Size", "Came", "Kept as"].map((text, i) =>
      h("th", { scope: "col", class: i === 2 || i === 3 ? "number" : null }, text),
    );
    const rows = sweeps.map((sweep) => sweepRow(sweep, adding));
    const rest = next === null ? null : h("button", { type: "button", onclick: () => more(next).catch((problem) => recipe.tell(problem.detail)) }, "More");
    replace(table, h("table", { class: "rows sweeps" }, h("thead", {}, h("tr", {}, head)), h("tbody", {}, rows)), rest);
  }

  function sweepRow(sweep, adding) {
    const at = picked.indexOf(sweep.sweep_id);
    const tick = h("input", {
      type: "checkbox",
      checked: at >= 0,
      disabled: Boolean(why),
      "aria-label": `Learn from sweep of ${sweep.part_id ?? sweep.sweep_id}`,
      onchange: () => {
        if (tick.checked) picked.push(sweep.sweep_id);
        else picked.splice(picked.indexOf(sweep.sweep_id), 1);
        draw();
      },
    });
    const turn = at < 0 ? "" : at === 0 && !adding ? "map" : String(at + 1);
    const losses = sweep.losses.length ? h("p", { class: "loss" }, sweep.losses.join("; ")) : null;
    return h(
      "tr",
      {},
      h("td", { class: "tick" }, h("label", {}, tick, h("span", { class: "turn" }, turn))),
      h("td", {}, sweep.part_id ?? "–", losses),
      h("td", { class: "number" }, sweep.frames),
      h("td", { class: "number" }, size(sweep.bytes)),
      h("td", { class: "time" }, moment(sweep.created_ns), h("span", { class: "note" }, ` ${sweep.source}`)),
      h("td", {}, h("code", {}, sweep.sweep_id.slice(0, 8))),
    );
  }

  async function begin() {
    learn.disabled = true;
    try {
      const body = { sweep_ids: [...picked], ...(addTo.value ? { add_to: addTo.value } : {}) };
      const { job_id } = await post(`${recipe.path}/appearances`, body, { key: recipe.key() });
      follow(job_id, `Learning from ${picked.length}`);
    } catch (problem) {
      replace(jobs, failed(problem));
    }
    draw();
  }

  function follow(jobId, text) {
    const row = followJob(app, jobId, text, (job) => {
      if (job.state !== "done" || !job.appearance_id) return;
      picked.length = 0;
      recipe.chosen = job.appearance_id;
      recipe.reload("").then(() => recipe.tell(`Appearance ${recipe.named(job.appearance_id)} is learnt. It judges parts when a version is saved with it.`));
    });
    ends.push(row.close);
    jobs.prepend(row.node);
  }

  addTo.addEventListener("change", draw);
  read();
  list("/v1/jobs", { product_id: recipe.product, state: "running", most: 20 })
    .then((running) => running.filter((job) => job.kind === "learn").forEach((job) => follow(job.job_id, "Learning")))
    .catch(() => {});

  const card = h(
    "section",
    { class: "panel", "aria-labelledby": "sweeps-title" },
    h("div", { class: "panelhead" }, h("h2", { id: "sweeps-title" }, "Golden sweeps")),
    why ? h("p", { class: "why" }, why) : null,
    uploadForm(recipe, why, read),
    table,
    h("div", { class: "learnrow" }, h("label", { for: "learn-to" }, "Learn"), addTo, learn),
    jobs,
  );
  return {
    node: h("div", { class: "sides learning" }, card, shown.node),
    close() {
      ends.forEach((end) => end());
      shown.close();
    },
  };
}

/** Choose a file, say whose it is, send it; how much has gone is told. */
function uploadForm(recipe, why, done) {
  const file = h("input", { type: "file", id: "sweep-file", accept: ".mcap", "aria-label": "Recording of a good part (.mcap)", disabled: Boolean(why) });
  const part = h("input", { id: "sweep-part", maxlength: "128", placeholder: "serial number", disabled: Boolean(why) });
  const button = h("button", { type: "button", disabled: true, title: why ?? "Choose a recording first.", onclick: send }, "Upload");
  const bar = h("progress", { max: "1", hidden: true, "aria-label": "Upload" });
  const said = h("p", { class: "note", role: "status" });

  file.addEventListener("change", () => {
    button.disabled = Boolean(why) || !file.files.length;
    button.title = why ?? "";
  });

  async function send() {
    const [chosen] = file.files;
    button.disabled = true;
    bar.hidden = false;
    said.classList.remove("wrong");
    try {
      const path = url(`${recipe.path}/sweeps`, { part_id: part.value.trim() });
      const sweep = await upload(path, chosen, recipe.key(), (share) => {
        bar.value = share;
        said.textContent = share < 1 ? `${size(share * chosen.size)} of ${size(chosen.size)}` : "Reading every frame of it …";
      });
      said.textContent = `${chosen.name} is here: ${sweep.frames} frames. ${sweep.losses.join("; ")}`;
      file.value = "";
      part.value = "";
      await done();
    } catch (problem) {
      said.textContent = problem.detail ?? String(problem);
      said.classList.add("wrong");
      button.disabled = false;
    }
    bar.hidden = true;
  }

  return h(
    "div",
    { class: "upload" },
    file,
    h("label", { for: "sweep-part" }, "Part"),
    part,
    button,
    bar,
    said,
  );
}

function size(bytes) {
  if (bytes < 1e6) return `${Math.ceil(bytes / 1e3)} kB`;
  return bytes < 1e9 ? `${(bytes / 1e6).toFixed(1)} MB` : `${(bytes / 1e9).toFixed(2)} GB`;
}
