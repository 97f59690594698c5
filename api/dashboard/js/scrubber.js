// A slider along s, by mouse, finger and keys: a step is a frame, a leap the next deviation.

import { h } from "./dom.js";

const LEAP = 10; // frames, of Page Up and Page Down

/** sweep: Sweep; deviations() -> [{ s_start, s_end, peak_index }]; moved(index) is told where somebody moves it. */
export function scrubber({ sweep, deviations, moved, label = "Place on the part, s" }) {
  const slider = h("input", { type: "range", min: "0", max: "1", step: "any", class: "scrub", "aria-label": label });
  const button = (text, title, act) => h("button", { type: "button", title, "aria-label": title, onclick: act }, text);
  const buttons = h("div", { class: "row steps" },
    button("|◂", "Deviation before (P)", () => leap(-1)),
    button("◂", "Frame before (arrow left)", () => step(-1)),
    button("▸", "Next frame (arrow right)", () => step(1)),
    button("▸|", "Next deviation (N)", () => leap(1)));
  let current = -1;

  function set(index) {
    current = index;
    slider.disabled = !sweep.length;
    if (index < 0) return;
    const frame = sweep.frames[index];
    slider.value = sweep.places[index];
    const said = frame.state === "scored" ? `score ${frame.score.toFixed(2)}` : `not scored, ${frame.state}`;
    slider.setAttribute("aria-valuetext", `s ${sweep.places[index].toFixed(3)}, frame ${index}, ${said}`);
  }

  function go(index) {
    if (index < 0 || index === current) return;
    set(index);
    moved(index);
  }

  function step(by) {
    const at = sweep.order.indexOf(current);
    go(sweep.order[Math.min(Math.max(at + by, 0), sweep.length - 1)] ?? -1);
  }

  /** To the peak of the next deviation on that side. */
  function leap(by) {
    const peaks = deviations().map((each) => each.peak_index).filter((index) => index < sweep.length);
    const here = current < 0 ? -1 : sweep.places[current];
    const aside = peaks.filter((index) => (sweep.places[index] - here) * by > 0);
    aside.sort((a, b) => (sweep.places[a] - sweep.places[b]) * by);
    if (aside.length) go(aside[0]);
  }

  slider.addEventListener("input", () => {
    const index = sweep.nearest(Number(slider.value));
    if (index !== current) {
      current = index;
      moved(index);
    }
  });
  slider.addEventListener("change", () => set(current));

  /** True where the key meant something here. */
  function key(event) {
    const by = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1, PageUp: LEAP, PageDown: -LEAP }[event.key];
    if (event.ctrlKey || event.metaKey || event.altKey) return false;
    if (by) step(by);
    else if (event.key === "Home") go(sweep.order[0] ?? -1);
    else if (event.key === "End") go(sweep.order.at(-1) ?? -1);
    else if (event.key === "n" || event.key === "N") leap(1);
    else if (event.key === "p" || event.key === "P") leap(-1);
    else return false;
    event.preventDefault();
    return true;
  }

  slider.addEventListener("keydown", (event) => key(event) && event.stopPropagation());
  set(-1);
  return { slider, buttons, set, key };
}
