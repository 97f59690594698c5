// The latest picture of a running inspection with its boxes, as the service tells it.

import { h } from "./dom.js";
import { blobOf, picture } from "./picture.js";

export function watched({ inspection, events }) {
  const room = h("div", { class: "pane-picture" });
  const note = h("p", { class: "note" }, "Waiting for the first picture. Expected and difference are here when the inspection has ended.");
  const root = h("div", { class: "watched" }, h("figure", { class: "pane seen" }, h("figcaption", {}, "Seen now"), room), note);
  const shown = picture(room, { label: "The camera's latest picture" });

  async function see(data) {
    if (data.inspection_id !== inspection || document.hidden) return;
    const later = "Expected and difference are here when the inspection has ended.";
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
