// What the swarm's radio says, as `companion watch` sends it: four pictures a second.
import { el } from "../src/dom.js";
import { setUp } from "../src/theme.js";
import { Banners, Silenced, standing } from "./alarms.js";
import { OrderBar } from "./orders/bar.js";
import { Card, peerReports, unknown } from "./panel.js";
import { aged, summaryOf } from "./picture.js";
import { Sound } from "./sound.js";
import { WatchMap } from "./watchmap.js";

const REDRAW_MS = 250;

const sound = new Sound();
const silenced = new Silenced();
let last = null; // the last picture
let came = performance.now();
const cards = new Map(); // by vehicle

const title = el("h1", {}, "Swarm");
const summary = el("p", { class: "summary" }, "Nothing heard yet");
const harvest = el("p", { class: "summary", hidden: true }); // how far the records are, and the stand so far
const hear = el("button", { type: "button", onclick: () => { sound.turn(); writeSound(); } });
const theme = el("button", { type: "button", "aria-label": "Light or dark" }, "◐");
const rows = el("div", {});
const quieter = el("button", { type: "button", class: "quiet", hidden: true, onclick: quiet }, "Quiet");
const banner = el("div", { class: "alarms" }, rows, quieter);
const aloud = el("p", { class: "aloud", role: "alert" }); // each once, and not its running seconds
const banners = new Banners(rows, aloud);
const canvas = el("canvas", { tabindex: 0, role: "img", "aria-label": "Map: arrows move it, plus and minus zoom, 0 shows all" });
const map = new WatchMap(canvas, select);
const button = (text, label, act) => el("button", { type: "button", "aria-label": label, onclick: act }, text);
const zoom = el("div", { class: "zoom" }, button("+", "Closer", () => map.zoom(1.4)), button("−", "Farther", () => map.zoom(1 / 1.4)), button("⤢", "Show all", () => map.fit()), button("◎", "Follow the vehicles", () => map.follow()));
const credit = el("p", { class: "credit" });
const list = el("ul", { class: "vehicles" });
const notKnown = el("ul", {});
const others = el("ul", { class: "reports" });
const orders = new OrderBar();

document.body.append(
  el("header", {}, el("div", {}, title, summary, harvest), el("div", { class: "switches" }, hear, theme)),
  banner,
  aloud,
  el(
    "main",
    {},
    el("section", { class: "map", "aria-label": "Map" }, canvas, zoom, credit),
    el("section", { "aria-label": "Vehicles" }, el("h2", {}, "Vehicles"), list, others),
    el("section", { class: "unknown" }, el("h2", {}, "Unknown"), notKnown),
  ),
  orders.section,
);
theme.addEventListener("click", setUp(() => map.draw()));

function select(id) {
  map.selected = id;
  show();
}

function writeSound() {
  hear.textContent = sound.on ? "Sound on" : "Sound off";
  hear.setAttribute("aria-pressed", sound.on);
}

const sinceS = () => (performance.now() - came) / 1000;
const alarmsNow = () => standing(last ? last.alarms : [], sinceS());

function showAlarms() {
  const alarms = alarmsNow();
  const loud = silenced.loudOf(alarms);
  sound.ring(loud.length > 0);
  banners.show(alarms);
  quieter.hidden = !loud.length;
}

function quiet() {
  silenced.silence(alarmsNow());
  show();
}

function write(where, lines) {
  if (lines.join() === where.dataset.lines) return;
  where.dataset.lines = lines.join();
  where.replaceChildren(...lines.map((line) => el("li", {}, line)));
}

function writeCards({ vehicles, about }) {
  for (const one of vehicles) {
    if (!cards.has(one.id)) {
      cards.set(one.id, new Card(one.id, select));
      list.replaceChildren(...[...cards.keys()].sort((a, b) => a - b).map((id) => cards.get(id).item));
    }
    cards.get(one.id).write(one, about.mission, map.selected);
  }
}

function show() {
  showAlarms();
  if (!last) return;
  const picture = aged(last, sinceS());
  title.textContent = picture.about.mission?.name || "Swarm";
  summary.textContent = summaryOf(picture, sinceS());
  harvest.textContent = picture.harvest;
  harvest.hidden = !picture.harvest;
  credit.textContent = (picture.about.chart?.attribution ?? "").replace(/<[^>]*>/g, "");
  writeCards(picture);
  orders.show(picture);
  write(others, peerReports(picture));
  write(notKnown, unknown(picture));
  map.update(picture);
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
writeSound();
window.watching = { sound, map }; // for tests
