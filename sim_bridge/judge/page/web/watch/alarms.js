// Alarms: the computer's own, and that the link to it is lost; as banners, said aloud once, and sounding until somebody silences them.
import { el } from "../src/dom.js";
import { age } from "./picture.js";

const GONE_S = 3; // without a picture: the link to the watching computer is lost
const GONE = { kind: "gone", vehicles: [], grave: true };

// Which alarm it is, whatever its text says by now.
export const keyOf = (alarm) => `${alarm.kind} ${alarm.vehicles}`;

// Those of the last picture, which came `since_s` ago; the gravest first.
export function standing(alarms, since_s) {
  if (since_s < GONE_S) return alarms;
  return [{ ...GONE, text: `Link to the watching computer lost for ${age(since_s)}: all below is old` }, ...alarms];
}

// Alarms that somebody has silenced, until they are over.
export class Silenced {
  constructor() {
    this.keys = new Set();
  }

  silence(alarms) {
    for (const alarm of alarms) this.keys.add(keyOf(alarm));
  }

  // Which of these sound; forgets what is over.
  loudOf(alarms) {
    const now = new Set(alarms.map(keyOf));
    for (const key of this.keys) if (!now.has(key)) this.keys.delete(key);
    return alarms.filter((alarm) => alarm.grave && !this.keys.has(keyOf(alarm)));
  }
}

// Written in place: what a finger is on stays there.
export class Banners {
  constructor(rows, aloud) {
    this.rows = rows; // where they are
    this.aloud = aloud; // what is read to who cannot see them
    this.byKey = new Map();
    this.said = null;
  }

  show(alarms) {
    this.removeAllBut(new Set(alarms.map(keyOf)));
    for (const alarm of alarms) this.write(alarm);
    const wanted = alarms.map((alarm) => this.byKey.get(keyOf(alarm)));
    if (wanted.some((row, k) => this.rows.children[k] !== row)) this.rows.replaceChildren(...wanted);
  }

  removeAllBut(now) {
    for (const [key, row] of this.byKey) {
      if (now.has(key)) continue;
      row.remove();
      this.byKey.delete(key);
      if (key === keyOf(GONE)) this.say(key, "Link to the watching computer regained");
      else if (key === this.said) this.say(null, ""); // over
    }
  }

  write(alarm) {
    let row = this.byKey.get(keyOf(alarm));
    if (!row) {
      row = el("p", {}, el("span", { "aria-hidden": true }), el("span", {}));
      this.byKey.set(keyOf(alarm), row);
      this.say(keyOf(alarm), alarm.text);
    }
    row.className = alarm.grave ? "grave" : "note";
    row.firstChild.textContent = alarm.grave ? "▲ " : "● ";
    row.lastChild.textContent = alarm.text;
  }

  say(key, text) {
    this.said = key;
    this.aloud.textContent = text;
  }
}
