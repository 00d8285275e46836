// A flight under way (docs/reference/live.md): a replay that grows, its clock, and what keeps a page up with it.
import { Clock } from "./clock.js";
import { Replay, upTo } from "./replay.js";

const NUMBERS_MAX = 1_500_000; // of all vehicles' columns: what a page keeps
const ROWS_MAX = 6000;
const CATCH_UP_S = 0.12; // of wall time: rows come in steps, and are shown as one motion
const SLOW_PARTS_MS = 500; // how often the plots, the events and the time bar are brought up to date

const plain = (value) => value ?? NaN;

function grown(columns) {
  for (const [name, column] of Object.entries(columns)) if (ArrayBuffer.isView(column)) columns[name] = Array.from(column);
}

export class LiveReplay extends Replay {
  constructor(doc) {
    super(doc);
    this.grows = true;
    const count = this.vehicles.length;
    const linked = new Map(this.pairs.map((pair) => [pair.a * count + pair.b, pair.changes]));
    this.pairs = [];
    for (let a = 0; a < count; a++) {
      for (let b = a + 1; b < count; b++) this.pairs.push({ a, b, changes: linked.get(a * count + b) ?? [] });
    }
    this.time = Array.from(this.time);
    grown(this.swarm);
    this.vehicles.forEach(grown);
    this.most = Math.max(200, Math.min(ROWS_MAX, Math.floor(NUMBERS_MAX / (14 * Math.max(1, count)))));
  }

  get room() {
    return this.most + 1;
  }

  add({ time_s: time, swarm, vehicles, links }) {
    if (time <= this.end && this.time.length) return; // sent twice: the snapshot held it
    const row = this.time.length;
    this.time.push(time);
    for (const [name, value] of Object.entries(swarm)) this.swarm[name]?.push(plain(value));
    this.vehicles.forEach((one, k) => {
      for (const [name, values] of Object.entries(vehicles)) one[name]?.push(plain(values[k]));
    });
    this.link(row, Uint8Array.from(atob(links), (c) => c.charCodeAt(0)));
    if (row >= this.most) this.forget(Math.floor(this.most / 4));
  }

  // A bit for each pair, in the order of `pairs`.
  link(row, bits) {
    let count = 0;
    this.pairs.forEach(({ changes }, i) => {
      const on = (bits[i >> 3] >> (7 - (i & 7))) & 1;
      if (on !== changes.length % 2) changes.push(row);
      count += on;
    });
    this.swarm.links.push(count);
  }

  // The first rows.
  forget(rows) {
    for (const columns of [this.swarm, ...this.vehicles]) {
      for (const column of Object.values(columns)) if (Array.isArray(column)) column.splice(0, rows);
    }
    this.time.splice(0, rows);
    for (const pair of this.pairs) {
      const gone = upTo(pair.changes, rows);
      pair.changes = [...(gone % 2 ? [0] : []), ...pair.changes.slice(gone).map((row) => row - rows)];
    }
  }
}

// Follows the newest row until somebody goes elsewhere in time; when the flight is over, it plays as any other.
export class LiveClock extends Clock {
  constructor(replay) {
    super(replay.start, replay.end);
    this.time = replay.end;
    this.following = true;
    this.over = false;
  }

  get label() {
    if (this.over) return super.label;
    return this.following ? "Freeze view" : "Live";
  }

  grew(start, end) {
    [this.start, this.end] = [start, end];
    if (this.following || this.time < start) this.changed();
    this.time = Math.max(this.time, start);
  }

  seek(time) {
    this.following = false;
    super.seek(time);
  }

  toggle() {
    if (this.over) {
      super.toggle();
      return;
    }
    this.following = !this.following;
    this.changed();
  }

  finish() {
    this.over = true;
    this.following = false;
  }

  frame(now) {
    if (this.following) {
      const passed = Math.min(0.5, Math.max(0, (now - this.last) / 1000));
      this.time += (this.end - this.time) * (1 - Math.exp(-passed / CATCH_UP_S));
      if (this.end - this.time < 0.005) this.time = this.end;
    }
    this.last = now;
    super.frame(now);
    if (this.following && this.time < this.end) this.changed();
  }
}

// What comes of the stream, into `replay`; `parts` grow with it.
export function follow(stream, replay, clock, parts, { received, over, lost }) {
  let asked = false;
  const again = () => {
    asked = false;
    for (const part of parts) part.grew?.();
    clock.changed();
  };
  const take = (message) => {
    for (const row of message.rows ?? []) replay.add(row);
    replay.events.push(...(message.events ?? []));
    if (message.rows?.length) clock.grew(replay.start, replay.end);
    received(message);
    if (message.over) {
      clock.finish();
      over(message.over);
    }
    if (!asked) {
      asked = true;
      setTimeout(again, SLOW_PARTS_MS);
    }
  };
  stream.start(take, () => {
    if (!clock.over) {
      clock.finish();
      lost();
    }
  });
}
