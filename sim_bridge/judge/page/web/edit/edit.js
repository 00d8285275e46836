// Plan a mission by clicking: the page of `mission edit`. What is good is decided by its server, which checks each change.
import { el } from "../src/dom.js";
import { setUp } from "../src/theme.js";
import { Client } from "./client.js";
import { EditMap } from "./editmap.js";
import { Flying } from "./flying.js";
import { Form } from "./form.js";
import { Places } from "./places.js";
import { addStop, fenceAround, fenceOf, moveTo, nearestTree, pointsOf, removeStop, setFence, subjectOf, withVertex } from "./plan.js";
import { coordinates, diskText, hintOf, savedText, treeText, verdictOf } from "./words.js";

const SNAP_PX = 14; // a click this near to a tree means the tree
const TREE_DIGITS = 2; // as stem maps have places
const TOOLS = [["move", "Move"], ["d1", "d1"], ["stop", "Stop"], ["d2", "d2"], ["fence", "Fence"]];
const TITLES = { move: "Move points, corners and the map", d1: "Place d1, where the swarm starts", stop: "Add a stop on the way", d2: "Place d2, the tree to visit", fence: "Add corners of the fence" };

let stand = null;

const button = (text, act, more = {}) => el("button", { type: "button", onclick: act, ...more }, text);
const file = el("h1", {}, "Mission");
const saved = el("span", { class: "savedstate" });
const verdict = el("p", { class: "verdict", role: "status" });
const undo = button("Undo", () => client.do("/undo"), { title: "Ctrl+Z" });
const redo = button("Redo", () => client.do("/redo"), { title: "Ctrl+Y" });
const save = button("Save", () => saveIt(false), { class: "main", title: "Ctrl+S" });
const fly = button("Fly it here", flyIt);
const theme = el("button", { type: "button", "aria-label": "Light or dark" }, "◐");
const message = el("p", { class: "message", role: "alert" });
const disk = el("div", { class: "disk", hidden: true }, el("p"), button("Load it", () => client.do("/reload")), button("Save over it", () => saveIt(true)));
const tools = el("div", { class: "tools", role: "group", "aria-label": "Tools" }, TOOLS.map(([tool, text]) => button(text, () => use(tool), { "data-tool": tool, "aria-pressed": tool === "move", title: TITLES[tool] })));
const around = button("Fence around all", fenceAll, { title: "A rectangle around the route, with the room that the rules ask for" });
const noFence = button("No fence", () => change(setFence([])));
const hint = el("p", { class: "hint", role: "status" });
const canvas = el("canvas", { tabindex: 0, role: "application", "aria-label": "Map. Arrows move it, plus and minus zoom, 0 shows all. With a tool chosen, Enter places it at the cross in the middle; Delete removes what is chosen. All places can be typed beside it, too." });
const under = el("p", { class: "under" });
const legend = el("div", { class: "legend" }, [["radio", "radio reach"], ["crowns", "crowns"]].map(([name, text]) => el("label", {}, el("input", { type: "checkbox", checked: true, onchange: (event) => toggle(name, event.target.checked) }), text)));
const map = new EditMap(canvas, { placed, moved, chosen, removed, hovered });
const zoom = el("div", { class: "zoom" }, button("+", () => map.zoom(1.4), { "aria-label": "Closer" }), button("−", () => map.zoom(1 / 1.4), { "aria-label": "Farther" }), button("⤢", () => map.fit(), { "aria-label": "Show all" }));
const problems = el("ul", { class: "problems" });
const notes = el("ul", { class: "notes" });
const stems = el("select", { id: "stems", onchange: () => stems.value && client.do("/stems", { name: stems.value }).then(said) });
const upload = el("input", { type: "file", id: "upload", accept: ".csv,.geojson,.json,.gpkg", onchange: takeFile });
const stemsWhy = el("p", { class: "why", hidden: true });
const form = new Form((key, value) => change(fieldChange(key, value)), say);
const places = new Places({ typed, removed: (name) => removed({ point: name }), chosen: (name) => chosen({ point: name }), wrong: say });
const client = new Client(show, say);
const flying = new Flying(lookAtFlight, () => client.do("/stop").then(showFlight));
const problemBox = el("section", { class: "box problembox", "aria-label": "Problems" }, el("h2", {}, "What does not check"), problems);
const summary = el("p", { class: "summary" });
const noteBox = el("section", { class: "box", "aria-label": "Notes" }, el("h2", {}, "The mission"), summary, notes);

document.body.append(
  el("header", {}, el("div", { class: "what" }, file, saved, verdict), el("div", { class: "switches" }, undo, redo, save, fly, theme)),
  message,
  disk,
  el(
    "main",
    {},
    el("div", { class: "left" }, el("div", { class: "bar" }, tools, around, noFence), hint, el("section", { class: "stage", "aria-label": "Map" }, canvas, zoom, under), legend, problemBox, noteBox, flying.node),
    el("aside", {}, el("section", { class: "box", "aria-label": "Places" }, el("h2", {}, "Places"), places.node), el("section", { class: "box", "aria-label": "Stem map" }, el("h2", {}, "Stem map"), el("div", { class: "row" }, el("label", { for: "stems" }, "Beside the mission"), el("span", { class: "value" }, stems)), el("div", { class: "row" }, el("label", { for: "upload" }, "From elsewhere"), el("span", { class: "value" }, upload)), stemsWhy), el("section", { class: "box", "aria-label": "Numbers" }, form.node)),
  ),
);

const redraw = setUp(() => map.draw());
theme.addEventListener("click", redraw);

function say(text) {
  message.textContent = text ?? "";
}

function said(answer) {
  if (answer?.said) say(answer.said);
  return answer;
}

// --- What a reader does -------------------------------------------------------------------------------------------------

function change(changes) {
  say("");
  return client.do("/change", () => (changes?.length ? { changes } : null));
}

function use(tool) {
  map.use(tool);
  for (const one of tools.children) one.setAttribute("aria-pressed", one.dataset.tool === tool);
  if (client.state) hint.textContent = hintOf(tool, pointsOf(client.state.values), fenceOf(client.state.values));
}

// The tree under a click, where there is one near.
function snapped(at) {
  const i = stand && nearestTree(stand.trees, at, SNAP_PX / map.view.scale);
  return i === null || i === false ? { at } : { at: [stand.trees.east_m[i], stand.trees.north_m[i]], digits: TREE_DIGITS };
}

function placed(tool, where) {
  const { values, flight_height_m: height } = client.state;
  const points = pointsOf(values);
  if (tool === "fence") {
    change(setFence(withVertex(fenceOf(values), where)));
    return;
  }
  const { at, digits } = tool === "d1" ? { at: where } : snapped(where);
  if (tool === "stop") change(addStop(values, at, height, digits));
  else change(moveTo(values, points.find(({ name }) => name === tool), at, height, digits)).then(nextTool);
}

// From d1 to d2, as one begins; then nothing more is placed by a stray click.
function nextTool(answer) {
  if (!answer) return;
  const points = pointsOf(client.state.values);
  use(points[0].enu && points.at(-1).enu ? "move" : points[0].enu ? "d2" : "d1");
}

function moved(handle, where) {
  const { values, flight_height_m: height } = client.state;
  if (handle.corner !== undefined) {
    change(setFence(fenceOf(values).map((at, k) => (k === handle.corner ? where : at))));
    return;
  }
  const point = pointsOf(values).find(({ name }) => name === handle.point);
  const { at, digits } = handle.point === "d1" ? { at: where } : snapped(where);
  change(moveTo(values, point, at, height, digits));
}

function typed(name, enu) {
  const { values } = client.state;
  const point = pointsOf(values).find((one) => one.name === name);
  change(moveTo(values, { ...point, enu }, enu, enu[2], 3));
}

function removed(handle) {
  const { values } = client.state;
  if (handle.corner !== undefined) {
    const left = fenceOf(values).filter((_, k) => k !== handle.corner);
    change(setFence(left.length < 3 ? [] : left));
  } else if (handle.point.startsWith("stop")) change(removeStop(Number(handle.point.slice(5)) - 1));
  else say(`${handle.point} cannot be removed: a mission needs it`);
  chosen(null);
}

function chosen(handle) {
  map.selected = handle;
  map.draw();
  places.choose(handle?.point);
}

function hovered(at) {
  const i = stand && nearestTree(stand.trees, at, SNAP_PX / map.view.scale / 2);
  const tree = i === null || i === false ? "" : ` · ${treeText(stand.trees, i)}`;
  under.textContent = coordinates(at, client.state?.values.origin) + tree;
}

function fenceAll() {
  const { values, start, fields } = client.state;
  const polygon = fenceAround(pointsOf(values), { start: start?.radius_m ?? 15, ring: fields["coverage.radius_m"] ?? 15 });
  if (polygon.length) change(setFence(polygon));
  else say("Place d1 and d2 first: the fence goes around them");
}

function fieldChange(key, value) {
  const path = key.split(".");
  return [value === undefined ? { do: "remove", path } : { do: "set", path, value }];
}

function toggle(name, shown) {
  map.shown[name] = shown;
  map.drawn = null;
  map.draw();
}

function saveIt(over) {
  say("");
  const typing = document.activeElement;
  if (typing instanceof HTMLInputElement) {
    typing.blur(); // what has been typed so far is meant, too
    typing.focus();
  }
  return client.do("/save", { over }).then(said);
}

function takeFile() {
  const [taken] = upload.files;
  const empty = () => (upload.value = ""); // the same file may be taken again
  if (taken) client.upload(taken.name, taken).then(said).finally(empty);
}

function flyIt() {
  say("");
  return client.do("/fly").then(showFlight);
}

function lookAtFlight() {
  return client.look("/flight").then((flight) => flight && flying.show(flight, client.state.revision));
}

function showFlight(answer) {
  if (answer?.flight) {
    flying.show(answer.flight, client.state.revision);
    flying.node.scrollIntoView({ block: "nearest" });
  }
}

// --- What the server says -----------------------------------------------------------------------------------------------

// What is against each field, point and so on: by key of the field, by name of the point.
function reasonsOf(state) {
  const reasons = new Map();
  const fields = new Set(Object.keys(state.fields));
  const add = (subject, text) => reasons.set(subject, [...(reasons.get(subject) ?? []), text]);
  const accused = [];
  for (const { key, message: text } of [...state.problems, ...state.beyond]) {
    const subject = subjectOf(key, fields);
    if (subject?.field) add(subject.field, text);
    if (subject?.point) add(subject.point, text);
    if (subject?.stems) add("stems", text);
    if (subject?.tree) accused.push(subject.tree);
  }
  return { reasons, accused };
}

function show(state) {
  form.build(state.groups);
  const { reasons, accused } = reasonsOf(state);
  file.textContent = state.file;
  document.title = `${state.is_saved ? "" : "• "}${state.file}`;
  saved.textContent = savedText(state);
  const { good, text } = verdictOf(state);
  verdict.textContent = text;
  verdict.className = `verdict ${good ? "good" : "bad"}`;
  undo.disabled = !state.can_undo;
  redo.disabled = !state.can_redo;
  noFence.disabled = !fenceOf(state.values).length;
  fly.disabled = !good;
  fly.title = good ? "In point masses, by sim-bridge" : "What does not check does not fly";
  disk.hidden = state.disk !== "changed";
  disk.firstChild.textContent = diskText(state);
  showProblems(state);
  showStems(state, reasons.get("stems") ?? []);
  form.show(state.fields, reasons);
  map.accused = accused;
  map.bad = new Set(reasons.keys());
  places.show(pointsOf(state.values), reasons);
  places.choose(map.selected?.point);
  map.update(state, stand);
  use(map.tool);
  if (flying.flight) flying.show(flying.flight, state.revision);
  if (state.stand !== stand?.number) loadStand(state.stand);
  document.documentElement.dataset.revision = state.revision;
}

function showProblems(state) {
  const fields = new Set(Object.keys(state.fields));
  problems.replaceChildren(...state.problems.map((problem) => el("li", {}, problemText(problem, subjectOf(problem.key, fields)))));
  problemBox.hidden = !state.problems.length;
  const lost = state.has_lost_comments ? ["Comments of the file cannot be kept with these changes: Undo brings them back."] : [];
  const beyond = state.beyond.map(({ text }) => `Not for the simulator: ${text}`);
  notes.replaceChildren(...[...lost, ...beyond, ...state.notes, diskText(state)].filter(Boolean).map((text) => el("li", {}, text)));
  summary.textContent = state.summary;
  noteBox.hidden = !notes.children.length && !state.summary;
}

// With a way to the field or place that it is about.
function problemText({ key, value, message: text }, subject) {
  const shown = value ? `${key} = ${value}` : key;
  const where = subject && !subject.fence && !subject.stems ? button(shown, () => goTo(subject), { class: "link" }) : el("b", {}, shown);
  return [where, shown ? `: ${text}` : text];
}

function goTo({ field, point, tree }) {
  if (field) form.focus(field);
  if (point) {
    chosen({ point });
    places.rows.get(point)?.inputs[0].focus();
  }
  if (tree) map.steer(map.view.centred(...tree));
}

function showStems(state, against) {
  const names = ["", ...state.stem_files];
  const now = state.values.forest?.file ?? "";
  if (now && !names.includes(now)) names.push(now);
  stems.replaceChildren(...names.map((name) => el("option", { value: name }, name || "choose a file")));
  stems.value = now;
  const texts = against.length ? against : state.no_stand ? [state.no_stand] : [];
  stemsWhy.textContent = texts.join(" ");
  stemsWhy.hidden = !texts.length;
}

async function loadStand(number) {
  const told = await client.look("/stand");
  if (!told) return;
  stand = { ...told, number };
  map.update(client.state, stand);
  document.documentElement.dataset.stand = number;
}

addEventListener("focus", () => client.look("/state"));
addEventListener("keydown", (event) => {
  if (!(event.ctrlKey || event.metaKey) || event.altKey) return;
  const key = event.key.toLowerCase();
  const types = event.target instanceof HTMLInputElement;
  if (key === "s") saveIt(false);
  else if (key === "z" && !types) client.do(event.shiftKey ? "/redo" : "/undo");
  else if (key === "y" && !types) client.do("/redo");
  else return;
  event.preventDefault();
});
addEventListener("beforeunload", (event) => {
  if (client.state && !client.state.is_saved) event.preventDefault(); // the server has it still, but a reader may not know
});
client.look("/state").then((state) => {
  if (!state) return;
  nextTool(state);
  document.documentElement.dataset.ready = "";
  lookAtFlight();
});
window.planning = { map, client }; // for tests
