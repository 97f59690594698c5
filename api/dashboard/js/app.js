// The shell: routes by hash, the token, the state of station and connection, theme and sound.

import * as api from "./api.js";
import { failed, h, replace, waiting } from "./dom.js";
import { events } from "./events.js";

const ROUTES = [
  [/^$/, "line", []],
  [/^inspections$/, "inspections", []],
  [/^inspection\/([^/]+)$/, "inspection", ["id"]],
  [/^compare(?:\/([^/]+)(?:\/([^/]+))?)?$/, "compare", ["a", "b"]],
  [/^recipe\/([^/]+)$/, "recipe", ["product"]],
  [/^trends\/([^/]+)$/, "trends", ["product"]],
  [/^(recipe|trends)$/, "products", ["of"]],
];
/** Which entry of the menu a view belongs to. */
const MENU = { inspection: "inspections", compare: "inspections" };

const root = document.getElementById("view");
const app = {
  api,
  events,
  /** viewer, operator, engineer or admin; null where the service did not say. */
  role: null,
  sound: { on: false, play: () => {} },
  /** Another view: go("#/inspection/7"). */
  go: (hash) => (location.hash = hash),
  /** The address of the same view with other parameters, without showing it again. */
  note: (hash) => history.replaceState(null, "", hash),
  may: (role) => app.role === null || ROLES.indexOf(app.role) >= ROLES.indexOf(role),
};
const ROLES = ["viewer", "operator", "engineer", "admin"];

let close = () => {};
let turn = 0;

/** The view and the parameters of a hash: `#/inspection/7?frame=3` -> ["inspection", { id: "7", frame: "3" }]. */
export function route(hash) {
  const [path, query = ""] = hash.replace(/^#\/?/, "").split("?");
  for (const [pattern, name, names] of ROUTES) {
    const match = pattern.exec(path);
    if (!match) continue;
    const parts = names.map((each, index) => [each, match[index + 1] && decodeURIComponent(match[index + 1])]);
    const known = parts.filter(([, value]) => value);
    return [name, { ...Object.fromEntries(new URLSearchParams(query)), ...Object.fromEntries(known) }];
  }
  return [null, {}];
}

async function show() {
  const mine = ++turn;
  const [name, params] = route(location.hash);
  try {
    close();
  } catch (error) {
    console.error(error);
  }
  close = () => {};
  mark(MENU[name] ?? (name === "products" ? params.of : name));
  // A place of its own for each: what comes late for a view that was left is not seen.
  const place = h("div", { class: `view ${name}` }, waiting());
  replace(root, place);
  document.title = "Sweep Inspector";
  if (name === null) {
    replace(place, failed({ title: "No such view", detail: `this page has no view ${location.hash}` }, () => app.go("#/")));
    return;
  }
  try {
    const view = await import(`./views/${name}.js`);
    if (mine !== turn) return;
    const title = typeof view.title === "function" ? view.title(params) : view.title;
    document.title = `${title} · Sweep Inspector`;
    const done = await view.show(place, params, app);
    if (mine === turn) close = done ?? (() => {});
    else done?.();
  } catch (error) {
    if (error.name === "AbortError") return;
    if (!(error instanceof api.Problem)) console.error(error);
    if (mine === turn) replace(place, failed(error, show));
  }
}

function mark(name) {
  for (const link of document.querySelectorAll("nav a"))
    if (link.dataset.view === name) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
}

function tellState() {
  const chip = document.getElementById("station");
  const { state, station, problem } = events;
  const said = { connecting: "connecting", reconnecting: "reconnecting" }[state] ?? station.state ?? "connected";
  chip.textContent = said;
  chip.dataset.state = state === "live" ? said : state;
  chip.title = problem?.detail ?? (state === "live" ? "State of the station" : "The service is asked again and again");
  document.documentElement.dataset.connection = state;
}

let dialog = null;

/** A form that asks for a token, until one is right. */
function askToken(problem) {
  return new Promise((done) => {
    const field = h("input", { id: "token", type: "password", autocomplete: "off", required: true, spellcheck: "false" });
    const form = h(
      "form",
      { method: "dialog" },
      h("h2", {}, "A token, please"),
      h("p", { id: "token-why" }, api.token.get() ? `The service says: ${problem.detail}.` : "This service wants to know who asks."),
      h("label", { for: "token" }, "Token"),
      field,
      h(
        "p",
        { class: "note" },
        "The first one was printed when the service started for the first time; an admin makes others. ",
        "It stays in this tab until it is closed.",
      ),
      h("div", { class: "row" }, h("button", { class: "main" }, "Go on")),
    );
    dialog?.remove();
    dialog = h("dialog", { class: "token", "aria-describedby": "token-why" }, form);
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      const given = field.value.trim();
      if (!given) return;
      dialog.close();
      dialog.remove();
      dialog = null;
      done(given);
      // Not before the token is there.
      setTimeout(askRole);
    });
    dialog.addEventListener("cancel", (event) => event.preventDefault());
    document.body.append(dialog);
    dialog.showModal();
    field.focus();
  });
}

/** The role of the token, where the service tells. */
async function askRole() {
  try {
    app.role = (await api.get("/v1/me")).role;
  } catch {
    // What is not allowed is refused by the service in any case.
    app.role = null;
  }
}

function theme() {
  const html = document.documentElement;
  const dark = () => (html.dataset.theme ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light")) === "dark";
  const button = document.getElementById("theme");
  const tell = () => {
    button.textContent = dark() ? "Light" : "Dark";
    button.setAttribute("aria-label", dark() ? "Change to light colours" : "Change to dark colours");
    document.dispatchEvent(new Event("theme"));
  };
  button.addEventListener("click", () => {
    html.dataset.theme = dark() ? "light" : "dark";
    localStorage.setItem("theme", html.dataset.theme);
    tell();
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", tell);
  tell();
}

/** Off at every start: a browser lets a page sound only after somebody asked for it. */
function sound() {
  const button = document.getElementById("sound");
  let out = null;
  app.sound.play = (word) => {
    if (!app.sound.on || word === "OK") return;
    const tone = out.createOscillator();
    const loud = out.createGain();
    tone.frequency.value = word === "NG" ? 440 : 660;
    loud.gain.setValueAtTime(0.2, out.currentTime);
    loud.gain.exponentialRampToValueAtTime(0.001, out.currentTime + 0.5);
    tone.connect(loud).connect(out.destination);
    tone.start();
    tone.stop(out.currentTime + 0.5);
  };
  button.addEventListener("click", () => {
    app.sound.on = !app.sound.on;
    out ??= new AudioContext();
    button.setAttribute("aria-pressed", String(app.sound.on));
    button.textContent = app.sound.on ? "Sound on" : "Sound off";
  });
}

api.token.onMissing(askToken);
events.on("state", tellState);
events.on("station", tellState);
addEventListener("hashchange", () => {
  show();
  root.focus({ preventScroll: true });
  scrollTo(0, 0);
});
document.querySelector(".skip").addEventListener("click", (event) => {
  event.preventDefault();
  root.focus();
});
theme();
sound();
tellState();
events.start();
// Another token may have come with a restart of the service.
events.on("reload", askRole);
// Fetched while the role is asked for.
import(`./views/${route(location.hash)[0] ?? "line"}.js`).catch(() => {});
askRole().then(show);
