// The latest picture of a running inspection with its boxes, asked for as often as the station says.

import { ask } from "./api.js";
import { h } from "./dom.js";
import { picture } from "./picture.js";

const OFTEN = 4; // a second, where the station says nothing

/** `begun()`: whether any frame came, before which there is no picture to ask for. */
export function watched({ path, events, begun }) {
  const room = h("div", { class: "pane-picture" });
  const note = h("p", { class: "note" }, "Waiting for the first picture. Expected and difference are here when the inspection has ended.");
  const root = h("div", { class: "watched" }, h("figure", { class: "pane seen" }, h("figcaption", {}, "Seen now"), room), note);
  const shown = picture(room, { label: "The camera's latest picture" });
  let timer = 0;
  let known = null;
  const gone = new AbortController();

  async function look() {
    if (begun()) await fetched();
    if (!gone.signal.aborted) timer = setTimeout(look, 1000 / (events.station.pictures_per_second ?? OFTEN));
  }

  async function fetched() {
    try {
      const response = await ask(`${path}/picture`, { signal: gone.signal });
      const tag = response.headers.get("ETag");
      if (tag !== known) {
        known = tag;
        const scored = JSON.parse(response.headers.get("Frame-Scored"));
        await shown.show(await response.blob());
        shown.boxes(scored.regions);
        note.textContent = `Frame ${scored.index}. Expected and difference are here when the inspection has ended.`;
      }
    } catch (error) {
      // None any more: the events tell what comes of it.
      if (error.name !== "AbortError" && error.status !== 404) note.textContent = error.detail ?? String(error);
    }
  }

  look();
  return {
    root,
    live: true,
    show() {},
    close() {
      gone.abort();
      clearTimeout(timer);
      shown.close();
    },
  };
}
