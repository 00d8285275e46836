// One order to the computer that watches: the only thing that this page ever sends.
import { proven } from "./orderkey.js";

const TRIES = 3;
const WAIT_MS = 4000; // for an answer, over a poor mesh
const NO_NONCE = "0".repeat(24); // which is refused, with one that is good
const AGAIN = 409; // the nonce is used or too old

async function post(body) {
  try {
    const answer = await fetch("/order", {
      method: "POST",
      headers: { "Content-Type": "application/json" },
      body: JSON.stringify(body),
      referrerPolicy: "same-origin", // with the page's own, none, some browsers do not tell their origin either
      signal: AbortSignal.timeout(WAIT_MS),
    });
    const told = await answer.json().catch(() => ({}));
    return { status: answer.status, why: told.why ?? "", nonce: told.nonce ?? null };
  } catch {
    return { status: 0, why: "the watching computer does not answer", nonce: null };
  }
}

// Empty once it is ordered; else why it is not, as far as this page knows. `nonce`: the newest that came. Without an answer
// HOLD, LAND and ABORT are tried again, as twice is no harm; a START is not: meanwhile somebody may have ordered a HOLD.
export async function send(order, { key, nonce, by = post }) {
  let given = nonce() ?? NO_NONCE;
  let why = "";
  for (let tried = 0; tried < TRIES; tried += 1) {
    const answer = await by(proven(order, given, key));
    if (answer.status === 200) return "";
    why = answer.why || `refused (${answer.status})`;
    if (answer.status !== AGAIN && (answer.status !== 0 || order.kind === "START")) return why;
    given = answer.nonce ?? nonce() ?? NO_NONCE;
  }
  return why;
}
