// Two flights over one another: A, as any flight, and B beside it.
import { el } from "./dom.js";
import { shown } from "./figures.js";
import { Replay, upTo } from "./replay.js";

// The replay of A with B as its `against`; what happened in both, in the order of time.
export function paired(doc) {
  const replay = new Replay(doc);
  replay.against = Object.assign(new Replay(doc.against), { notes: doc.against.notes });
  const told = (name, { events }) => events.map((event) => ({ ...event, text: `${name}: ${event.text}` }));
  replay.events = [...told("A", replay), ...told("B", replay.against)].sort((one, other) => one.time_s - other.time_s);
  return replay;
}

// Both verdicts.
export function comparisonHeader(replay, { flights }, notes) {
  const both = [replay, replay.against];
  const verdict = ({ name, folder, verdict: text, seed }, k) => {
    const { succeeded } = both[k].verdict;
    const state = succeeded === null ? "unknown" : succeeded ? "good" : "bad";
    return el("li", {}, el("b", {}, name), el("p", { class: `verdict ${state}` }, text ?? "No verdict"), el("small", {}, `${folder}, seed ${seed}`));
  };
  return el("header", { class: "comparison" }, el("h1", {}, replay.title), el("ul", {}, flights.map(verdict)), notes.map((note) => el("p", { class: "note" }, note)));
}

// Figures side by side: those that differ in rows, the others in a line.
export function comparisonFigures({ figures }) {
  const same = figures.filter(({ difference }) => difference === 0).map(({ name, a }) => `${name} ${shown(a)}`);
  const rows = figures.filter(({ difference }) => difference !== 0).map(({ name, a, b, difference, better }) =>
    el("tr", {}, el("th", { scope: "row" }, name), [shown(a), shown(b), signed(difference), better].map((text) => el("td", {}, text))));
  const heads = ["figure", "A", "B", "B − A", "better"].map((head) => el("th", { scope: "col" }, head));
  return el("section", { class: "side-by-side" },
    el("h2", {}, "Figures side by side"),
    el("div", { class: "wide", tabindex: "0", role: "group", "aria-label": "figures of A and B" },
      el("table", {}, el("thead", {}, el("tr", {}, heads)), el("tbody", {}, rows))),
    el("p", { class: "note" }, `The same in both: ${same.join("; ") || "none"}.`));
}

function signed(difference) {
  if (difference === null) return "–";
  const text = shown(difference);
  return difference > 0 ? `+${text}` : text.replace("-", "−");
}

// A column of values over `from`, at the times `to`; NaN outside.
export function resampled(column, from, to) {
  return Array.from(to, (time) => {
    const row = upTo(from, time + 1e-6) - 1;
    return row < 0 || time > from[from.length - 1] + 1e-6 ? NaN : column[row];
  });
}
