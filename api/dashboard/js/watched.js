// The latest picture of a running inspection with its boxes, as the service tells it.

import { ask } from "./api.js";
import { h } from "./dom.js";
import { blobOf, picture } from "./picture.js";

/** The picture that was told last, for who comes later: { blob, scored }; null where there is none, or none any more. */
export async function latest(inspection) {
  const response = await ask(`/v1/inspections/${inspection}/picture`);
  if (response.status !== 200) return null;
  return { scored: JSON.parse(response.headers.get("Frame-Scored")), blob: await response.blob() };
}

export function watched({ inspection, events }) {
  const room = h("div", { class: "pane-picture" });
  const note = h("p", { class: "note" }, "Waiting for the first picture. Expected and difference are here when the inspection has ended.");
  const root = h("div", { class: "watched" }, h("figure", { class: "pane seen" }, h("figcaption", {}, "Seen now"), room), note);
  const shown = picture(room, { label: "The camera's latest picture" });

  const later = "Expected and difference are here when the inspection has ended.";
  let told = false;

  async function see(data) {
    if (data.inspection_id !== inspection || document.hidden) return;
    told = true;
    try {
      await shown.show(blobOf(data));
      shown.boxes(data.scored.regions);
      note.textContent = `Frame ${data.scored.index}. ${later}`;
    } catch {
      note.textContent = `Browsers do not show ${data.type}. ${later}`;
    }
  }

  const off = events.on("picture", see);
  events.watch(inspection);
  // What is told from now on goes before it.
  latest(inspection).then(async (last) => {
    if (!last || told) return;
    await shown.show(last.blob);
    if (told) return;
    shown.boxes(last.scored.regions);
    note.textContent = `Frame ${last.scored.index}. ${later}`;
  }, () => {});
  return {
    root,
    live: true,
    show() {},
    close() {
      off();
      events.watch(null);
      shown.close();
    },
  };
}
