// What is asked before an order, and told after it.
const list = (ids) => ids.join(", ");

const QUESTIONS = {
  HOLD: ["Hold? Every vehicle stays where it is, until the next start.", "Hold all"],
  LAND: ["Land? The swarm spreads out level and lands. Nothing takes it back.", "Land all"],
  ABORT: ["Abort? Every vehicle lands where it is, at once. Nothing takes it back.", "Abort: land all now"],
};

// `lines`, `confirm`: what to read, and the button; `order`: what it gives, or null: it cannot be given.
export function questionOf(kind, orders, handBack = 0) {
  if (kind !== "START") {
    const [line, confirm] = QUESTIONS[kind];
    return { lines: [line], confirm, order: { kind } };
  }
  const { ready, missing } = orders;
  const without = Object.keys(missing).map(Number).sort((a, b) => a - b);
  const lines = [`Ready, or in the air: ${list(ready) || "none"}`, ...without.map((id) => `Vehicle ${id}: ${missing[id]}`)];
  if (!ready.length && without.every((id) => missing[id] === "not heard")) return { lines, confirm: "No vehicle is heard", order: null };
  const rest = `${without.length ? `, without ${list(without)}` : ""}${handBack ? `, and hand back ${handBack}` : ""}`;
  return {
    lines,
    confirm: `Start ${ready.length} of ${ready.length + without.length}${rest}`,
    order: { kind, without, hand_back: handBack },
  };
}

// Vehicles that a pilot has, and that a START can hand back.
export const releasedOf = (vehicles) => vehicles.filter((one) => one.state === "released").map((one) => one.id);

// Of the last order, whoever gave it.
export function progressOf(sent) {
  if (!sent) return [];
  const { kind, acting, aborted, waits_for: waiting, not_heard: silent } = sent;
  return [
    aborted.length && `${kind}: ABORT stays in force, which is above it: ${list(aborted)}`,
    (acting.length || !aborted.length) && `${kind}: ${acting.length ? `acting on it: ${list(acting)}` : "nobody is heard to act on it"}`,
    waiting.length && `${kind}: heard, and not acting on it: ${list(waiting)}`,
    silent.length && `Not heard: ${list(silent)}`,
  ].filter(Boolean);
}

// A button under a finger does not change its meaning: it waits, after each change of what it says.
export class Settled {
  constructor(ms) {
    this.ms = ms;
    this.said = null;
    this.since = 0;
  }

  isSo(said, now) {
    if (said !== this.said) [this.said, this.since] = [said, now];
    return now - this.since >= this.ms;
  }
}
