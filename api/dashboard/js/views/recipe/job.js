// A job as a row: how far it is, what it says at its end.

import { get } from "../../api.js";
import { h, percent, replace } from "../../dom.js";

const LOOK_MS = 2000;

/** Returns {node, close}; `ended(job)` is called once. Events tell how far it is, a look now and then that none is missed. */
export function followJob(app, jobId, text, ended) {
  const bar = h("progress", { max: "1", value: 0, "aria-label": text });
  const share = h("span", { class: "number" }, "0 %");
  const node = h("div", { class: "job" }, h("span", {}, text), bar, share);
  let over = false;

  async function look() {
    try {
      take(await get(`/v1/jobs/${jobId}`));
    } catch {
      // The next look may be answered.
    }
  }

  function take(job) {
    if (over) return;
    bar.value = job.progress ?? bar.value;
    share.textContent = percent(bar.value);
    if (job.state === "running") return;
    if (job.created_ns === undefined) {
      look();
      return;
    }
    close();
    tell(job);
    ended(job);
  }

  function tell(job) {
    const failed = job.state === "failed";
    node.classList.toggle("wrong", failed);
    replace(
      node,
      h("strong", {}, failed ? `${text}: failed` : `${text}: done`),
      failed ? h("p", { class: "wrong" }, job.error) : null,
      job.said.map((each) => h("p", { class: "caution" }, each)),
    );
  }

  function close() {
    over = true;
    clearInterval(timer);
    end();
  }

  const end = app.events.on("job", (event) => event.job_id === jobId && take(event));
  const timer = setInterval(look, LOOK_MS);
  look();
  return { node, close };
}
