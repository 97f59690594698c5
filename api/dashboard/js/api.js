// The service's /v1, asked with the token of this tab; what goes wrong is a Problem.

const KEY = "token";
const BUSY_TRIES = 3;

export class Problem extends Error {
  /** A problem document (RFC 9457), or what is said where none came. status 0: nobody answered. */
  constructor({ title, detail, status, type, ...more }) {
    super(`${title}: ${detail}`);
    this.name = "Problem";
    Object.assign(this, { title, detail, status, type: type ?? "about:blank", more });
  }
}

let asking = null;
let askPerson = async () => null;

export const token = {
  get: () => sessionStorage.getItem(KEY),
  set: (value) => (value ? sessionStorage.setItem(KEY, value) : sessionStorage.removeItem(KEY)),
  /** fn(problem) -> Promise of a token, or null: asked when the service answers 401. */
  onMissing: (fn) => (askPerson = fn),
};

export function authorization() {
  const known = token.get();
  return known ? { Authorization: `Bearer ${known}` } : {};
}

/** The response of a request that went well. Waits for a token where one is asked for. Throws Problem, AbortError. */
export async function ask(path, { method = "GET", body, headers = {}, signal } = {}) {
  for (let tries = 1; ; tries++) {
    const used = token.get();
    let response;
    try {
      response = await fetch(path, { method, body, signal, headers: { ...authorization(), ...headers } });
    } catch (error) {
      if (error.name === "AbortError") throw error;
      const detail = `no answer from ${location.host}; is \`inspector serve\` running, and the network there?`;
      throw new Problem({ title: "The service does not answer", detail, status: 0 });
    }
    if (response.ok) return response;
    const problem = await problemOf(response);
    if (response.status === 401) {
      // Another request may have got a token meanwhile.
      if (token.get() !== used || (await haveAsked(problem))) continue;
    }
    const wait = Number(response.headers.get("Retry-After") ?? NaN);
    if (response.status === 503 && method === "GET" && tries < BUSY_TRIES && wait <= 5) {
      await new Promise((done) => setTimeout(done, wait * 1000));
      continue;
    }
    throw problem;
  }
}

async function haveAsked(problem) {
  asking ??= Promise.resolve(askPerson(problem)).finally(() => (asking = null));
  const given = await asking;
  if (given) token.set(given);
  return Boolean(given);
}

async function problemOf(response) {
  const text = await response.text();
  const bare = { title: response.statusText || "Error", detail: text.slice(0, 300) || `status ${response.status}` };
  try {
    return new Problem({ ...bare, ...JSON.parse(text), status: response.status });
  } catch {
    return new Problem({ ...bare, status: response.status });
  }
}

/** The JSON at a path. The browser keeps it with its ETag, and the service answers 304 where it is the same. */
export async function get(path, options) {
  return (await ask(path, options)).json();
}

/** What is answered to a JSON body. `options.key`: an Idempotency-Key. */
export async function post(path, body = {}, { key, headers = {}, ...options } = {}) {
  const more = key ? { "Idempotency-Key": key } : {};
  const all = { "Content-Type": "application/json", ...more, ...headers };
  return (await ask(path, { ...options, method: "POST", body: JSON.stringify(body), headers: all })).json();
}

/** The bytes at a path, as a Blob; for their headers use `ask`. */
export async function blob(path, options) {
  return (await ask(path, options)).blob();
}

/** `/v1/things?name=value…`: names without a value are left out. */
export function url(path, query = {}) {
  const known = Object.entries(query).filter(([, value]) => value !== undefined && value !== null && value !== "");
  const text = new URLSearchParams(known).toString();
  return text ? `${path}?${text}` : path;
}

/** All pages of a list, one after the other, for lists that are short. `list(path)` -> items; at most `most`. */
export async function list(path, { most = 1000, ...query } = {}, options) {
  const items = [];
  for (let after; items.length < most; ) {
    const page = await get(url(path, { limit: Math.min(200, most), ...query, after }), options);
    items.push(...page.items);
    after = page.next;
    if (after === null || after === undefined) break;
  }
  return items;
}

/** A file of the service, saved by the browser: links cannot carry a token. */
export async function download(path, name) {
  const address = URL.createObjectURL(await blob(path));
  const link = Object.assign(document.createElement("a"), { href: address, download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(address), 60_000);
}
