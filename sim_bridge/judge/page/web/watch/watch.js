// What the swarm's radio says, as `companion watch` sends it: four pictures a second.
import { el } from "../src/dom.js";
import { setUp } from "../src/theme.js";
import { Card, hearsay, unknown } from "./panel.js";
import { Sound } from "./sound.js";
import { FRESH_S, WatchMap, age } from "./watchmap.js";

const GONE_S = 3; // without a picture: the watching computer is not reached
const REDRAW_MS = 250;

const sound = new Sound();
const GONE = { kind: "gone", vehicles: [], grave: true };
const quieted = new Set(); // alarms that somebody has heard
let last = null; // the last picture
let said = null; // the alarm that was last said aloud
let came = performance.now();
const banners = new Map(); // by alarm
const cards = new Map(); // by vehicle

const title = el("h1", {}, "Swarm");
const summary = el("p", { class: "summary" }, "Nothing heard yet");
const hear = el("button", { type: "button", onclick: () => { sound.turn(); sounds(); } });
const theme = el("button", { type: "button", "aria-label": "Light or dark" }, "◐");
const rows = el("div", {});
const quieter = el("button", { type: "button", class: "quiet", hidden: true, onclick: quiet }, "Quiet");
const banner = el("div", { class: "alarms" }, rows, quieter);
const aloud = el("p", { class: "aloud", role: "alert" }); // each once, and not its running seconds
const canvas = el("canvas", { tabindex: 0, role: "img", "aria-label": "Map: arrows move it, plus and minus zoom, 0 shows all" });
const map = new WatchMap(canvas, select);
const button = (text, label, act) => el("button", { type: "button", "aria-label": label, onclick: act }, text);
const zoom = el("div", { class: "zoom" }, button("+", "Closer", () => map.zoom(1.4)), button("−", "Farther", () => map.zoom(1 / 1.4)), button("⤢", "Show all", () => map.whole()), button("◎", "Follow the vehicles", () => map.follow()));
const credit = el("p", { class: "credit" });
const list = el("ul", { class: "vehicles" });
const notKnown = el("ul", {});
const others = el("ul", { class: "hearsay" });

document.body.append(
  el("header", {}, el("div", {}, title, summary), el("div", { class: "switches" }, hear, theme)),
  banner,
  aloud,
  el(
    "main",
    {},
    el("section", { class: "map", "aria-label": "Map" }, canvas, zoom, credit),
    el("section", { "aria-label": "Vehicles" }, el("h2", {}, "Vehicles"), list, others),
    el("section", { class: "unknown" }, el("h2", {}, "What the radio does not say"), notKnown),
  ),
);
theme.addEventListener("click", setUp(() => map.draw()));

function select(id) {
  map.selected = id;
  show();
}

function sounds() {
  hear.textContent = sound.on ? "Sound on" : "Sound off";
  hear.setAttribute("aria-pressed", sound.on);
}

const key = (alarm) => `${alarm.kind} ${alarm.vehicles}`;

function alarmsNow(since_s) {
  const told = last ? last.alarms : [];
  if (since_s < GONE_S) return told;
  return [{ ...GONE, text: `The watching computer is not reached for ${age(since_s)}: all below is old` }, ...told];
}

function alarm(alarms) {
  const standing = new Set(alarms.map(key));
  for (const known of quieted) if (!standing.has(known)) quieted.delete(known);
  const loud = alarms.filter((one) => one.grave && !quieted.has(key(one)));
  sound.ring(loud.length > 0);
  for (const [known, row] of banners) {
    if (standing.has(known)) continue;
    row.remove();
    banners.delete(known);
    if (known === key(GONE)) say(known, "The watching computer is reached again");
    else if (known === said) say(null, ""); // over
  }
  for (const one of alarms) {
    let row = banners.get(key(one));
    if (!row) {
      row = el("p", {}, el("span", { "aria-hidden": true }), el("span", {}));
      banners.set(key(one), row);
      say(key(one), one.text);
    }
    row.className = one.grave ? "grave" : "note";
    row.firstChild.textContent = one.grave ? "▲ " : "● ";
    row.lastChild.textContent = one.text;
  }
  const wanted = alarms.map((one) => banners.get(key(one)));
  if (wanted.some((row, k) => rows.children[k] !== row)) rows.replaceChildren(...wanted); // the gravest first
  quieter.hidden = !loud.length;
}

function say(alarm, text) {
  said = alarm;
  aloud.textContent = text;
}

function quiet() {
  for (const one of alarmsNow((performance.now() - came) / 1000)) quieted.add(key(one));
  show();
}

function write(where, lines) {
  if (lines.join() === where.dataset.told) return;
  where.dataset.told = lines.join();
  where.replaceChildren(...lines.map((line) => el("li", {}, line)));
}

// Ages go on while no picture comes.
function aged(told, since_s) {
  const older = (one) => ({ ...one, age_s: one.age_s + since_s });
  return { ...told, vehicles: told.vehicles.map(older), told: told.told.map(older) };
}

function show() {
  const since_s = (performance.now() - came) / 1000;
  alarm(alarmsNow(since_s));
  if (!last) return;
  const told = aged(last, since_s);
  const heard = told.vehicles.filter((one) => one.age_s < FRESH_S);
  const leaders = [...new Set(heard.filter((one) => one.acting).map((one) => one.leader))];
  const phases = [...new Set(heard.map((one) => one.phase))];
  title.textContent = told.about.mission?.name || "Swarm";
  summary.textContent = heard.length
    ? `${leaders.length ? `Leader ${leaders.join(" and ")}` : "No leader"} · ${phases.join(", ")} · ${heard.length} heard${told.vehicles.length > heard.length ? `, ${told.vehicles.length - heard.length} silent` : ""}`
    : told.silence_s === null ? "Nothing heard yet" : `Nothing heard for ${age(told.silence_s + since_s)}`;
  credit.textContent = (told.about.chart?.attribution ?? "").replace(/<[^>]*>/g, "");
  for (const one of told.vehicles) {
    if (!cards.has(one.id)) {
      cards.set(one.id, new Card(one.id, select));
      list.replaceChildren(...[...cards.keys()].sort((a, b) => a - b).map((id) => cards.get(id).item));
    }
    cards.get(one.id).write(one, told.about.mission, map.selected);
  }
  write(others, hearsay(told));
  write(notKnown, unknown(told));
  map.update(told);
  if (map.width) document.documentElement.dataset.ready = ""; // it has been laid out
}

const stream = new EventSource("/heard"); // it connects again by itself
stream.onmessage = (event) => {
  last = JSON.parse(event.data);
  came = performance.now();
  show();
};
addEventListener("keydown", (event) => {
  if (event.key === "q") quiet();
});
setInterval(() => performance.now() - came > 2 * REDRAW_MS && show(), REDRAW_MS);
sounds();
window.watching = { sound, map }; // for tests
