// A file sent as the body of a request, and told how much of it has gone: fetch cannot say that.

import { Problem, authorization } from "../../api.js";

/** The JSON that is answered. `tell(share)` hears how much was sent, from 0 to 1. Throws Problem. */
export function upload(path, file, key, tell) {
  return new Promise((done, refuse) => {
    const request = new XMLHttpRequest();
    request.open("POST", path);
    const headers = { "Content-Type": "application/octet-stream", "Idempotency-Key": key, ...authorization() };
    for (const [name, value] of Object.entries(headers)) request.setRequestHeader(name, value);
    request.upload.addEventListener("progress", (event) => event.lengthComputable && tell(event.loaded / event.total));
    request.upload.addEventListener("load", () => tell(1));
    request.addEventListener("load", () => {
      const answer = parsed(request.responseText);
      if (request.status < 300) done(answer);
      else refuse(new Problem({ title: "The upload was refused", detail: request.statusText, ...answer, status: request.status }));
    });
    request.addEventListener("error", () => {
      const detail = `${file.name} did not arrive: the connection broke off, or nobody answers`;
      refuse(new Problem({ title: "The upload broke off", detail, status: 0 }));
    });
    request.send(file);
  });
}

function parsed(text) {
  try {
    return JSON.parse(text);
  } catch {
    return {};
  }
}
